"""Robots: a `pinocchio.Model` with names, postures, motors, springs, and checks that it is sound.

Nouns: `Robot`, `Spring`, `SpringDamper`; `mechanisms/` has robots with parameters.

It knows no file, which is for `io`, and no scene.
"""
