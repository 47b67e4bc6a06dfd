"""What moves, beside the fields of what stands still: distances, and fields of the moment."""
