"""Fights between trained pilots: matches, tournaments, ratings and statistics."""
