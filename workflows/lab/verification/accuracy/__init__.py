"""The stated errors beside the true ones: verification problems and ready scenes; `stickslip verify accuracy`."""
