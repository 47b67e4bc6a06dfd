"""The log of a robot: everything that came in, was decided and went out, in segments that outlive a crash."""
