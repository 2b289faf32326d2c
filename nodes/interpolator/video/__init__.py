"""Makes sub-frames between the frames of a video, whose motion is found by optical flow."""
