"""AEDAT 2, 3.1 and 4, and the flatbuffers of the last."""
