"""Façades as values that are turned until the daylight of a year is best."""
