"""Films to recording sets: frames are streamed, and turned into those of an ideal pinhole camera."""
