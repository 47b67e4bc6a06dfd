"""Links by which commands reach a robot and states come back: one protocol, an in-memory link, checks of both ends."""
