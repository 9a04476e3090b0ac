"""Statements of trust from tables that a person has: detection, gauge studies."""
