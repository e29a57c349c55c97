"""One run in its folder: build, fit, evaluate, resume, log; baselines beside it."""
