"""Solution methods, one file a method; all of them meet the bodies through `SurfaceProblem` only."""
