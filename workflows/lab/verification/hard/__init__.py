"""The hard suite: every ready scene in many variations, each judged three times; `stickslip verify hard`."""
