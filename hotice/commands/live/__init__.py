"""The live view of `hotice play --view`."""
