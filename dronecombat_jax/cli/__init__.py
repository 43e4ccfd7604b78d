"""The command line: one function per command, one line each in `commands`.

What does not live here: what the commands do; they call the other rooms.
"""
