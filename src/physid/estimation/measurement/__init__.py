"""What a sensor adds: the noise of recorded poses, and the error of poses that were tracked in films."""
