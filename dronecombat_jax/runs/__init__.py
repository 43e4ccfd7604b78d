"""One training, the host's side: program, loop, resume, fork, progress, evaluation, export.

What does not live here: what is written to disk and how (`files`), learning itself (`learn`,
`selfplay`).
"""
