"""Views of the environment for other libraries' learners."""
