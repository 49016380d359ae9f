//! Image to keypoints: networks, OpenPose decoding, training targets, evaluation, gates and filters.
