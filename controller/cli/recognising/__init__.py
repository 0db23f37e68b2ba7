"""Stored pictures of the table: what lies there."""
