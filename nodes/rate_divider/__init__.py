"""The rate divider: the states of every n-th keyframe, for a camera with a keyframe rate of its own."""
