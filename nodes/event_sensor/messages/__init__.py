"""Messages of frames: how much one may hold, and several of them as one."""
