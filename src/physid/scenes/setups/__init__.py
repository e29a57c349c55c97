"""The scenes of the catalogue, one file each, with the ways to excite them."""
