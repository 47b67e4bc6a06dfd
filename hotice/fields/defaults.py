"""The numbers of the fields and of the command that they make, each once: what is taken where nothing else is given."""

ETA = 0.6
"""eta: size of the attractive force, a speed when read as a command [m/s] (paper)."""
MARGIN_M = 0.08
"""Inflation of the obstacles for the object-centric field, 8 cm (paper)."""
RESOLUTION_M = 0.04
"""Grid of the fields (CAT)."""
SPEED_M_S = 0.7
"""Commanded speed (ours; the attractive force alone leaves too little time for 2 m in 5 s)."""
STOP_GAIN_HZ = 3.0
"""Near the goal the commanded speed is this times the distance (ours)."""
