"""Schemes of steps with contacts, a file each; `INTEGRATORS` has them by name beside all others."""
