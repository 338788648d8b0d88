"""The command `stickslip cost`: what accuracy costs in time, for one scene on one core."""
