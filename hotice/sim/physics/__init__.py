"""Physics backends behind one protocol: MuJoCo batched on the CPU, MuJoCo Warp on a GPU."""
