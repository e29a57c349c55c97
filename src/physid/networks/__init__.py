"""Images to poses and back: encoder, velocity from poses, renderer, blur."""
