//! Gaussian mixtures, Gaussian mixture regression, ARIMA and their weight fusion.
