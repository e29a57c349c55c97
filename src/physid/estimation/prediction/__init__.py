"""What the model predicts: the nominal model, candidate effects, segments, rollouts of variants."""
