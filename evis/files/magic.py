"""Names the bytes with which packed files begin."""

ZIP = b"PK\x03\x04"
EMPTY_ZIP = b"PK\x05\x06"
ZSTD = b"\x28\xb5\x2f\xfd"
LZ4 = b"\x04\x22\x4d\x18"
