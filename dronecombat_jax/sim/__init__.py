"""One drone's flight in MuJoCo MJX: the MJCF scene, the wrench of the rotors, the integration.

What does not live here: the game (`combat`).
"""
