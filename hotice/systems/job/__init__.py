"""The whole job in one run: picked up, carried, put down; and how it is judged."""
