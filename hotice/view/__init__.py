"""A simulation to meddle with in the browser: a robot walks, and whoever looks moves obstacles and pushes it."""
