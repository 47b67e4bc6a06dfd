"""The robot's own messages as NumPy records and as bytes on the wire. No network here."""
