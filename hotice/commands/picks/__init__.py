"""The commands of `hotice pickup`."""
