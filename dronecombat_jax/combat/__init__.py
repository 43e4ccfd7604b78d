"""The game: rules, observation, reward and the environment."""
