"""The last phase of learning from video: Gauss-Newton on parameters while the encoder stands still."""
