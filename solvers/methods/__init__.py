"""Solution methods, one file each; all but the smoothed one see the bodies only through `SurfaceProblem`."""
