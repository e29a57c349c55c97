"""Between frames and poses: encoder, decoder, pose refinement, calibration, synthetic images, predicted video."""
