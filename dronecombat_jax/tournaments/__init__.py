"""One tournament, the host's side: entrants, cells, recorded fights, results, comparison.

What does not live here: the fights (`arena`), ratings (`analysis`), drawings (`report`).
"""
