"""How commands reach a robot and its states come back: one protocol, an in-memory link with faults, checks of both ends."""
