//! A rapier robot arm behind the joint protocol, and a synthetic worker with a camera.
