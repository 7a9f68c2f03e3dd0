"""Control: which joints have motors, what these can do, and what they feel.

Nouns: `Actuation`, `InverseDynamics`, `OperationalSpace`, `Transmission`.

    B u + J^T lam = M a + h - passive

It must not know motions.
"""
