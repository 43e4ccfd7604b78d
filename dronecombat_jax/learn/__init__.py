"""IPPO: networks, normalisation, the PPO update and one training iteration."""
