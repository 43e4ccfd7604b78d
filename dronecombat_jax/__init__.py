"""Two Crazyflies learn to fight: a pursuit duel in MuJoCo MJX, IPPO and self-play in JAX."""
