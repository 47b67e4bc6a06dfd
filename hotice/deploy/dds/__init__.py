"""The link over DDS (Cyclone 11, extra `deploy`). Only modules of this folder import cyclonedds, where they use it."""
