"""hotice: a Unitree G1 carries objects through clutter. Import what you need from the packages below this one."""

__version__ = "0.1.0"
