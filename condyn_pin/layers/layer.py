"""Layer: what all layers have in common, whatever library differentiates through them."""

from __future__ import annotations

from typing import Any, Protocol


class Layer(Protocol):
    """A function of arrays of torch or jax, through which that library differentiates.

    (x, y) = f(q, v, tau, parameters)

    Each array has the shape of its docstring behind leading axes, which are batches and broadcast:
    q (..., nq), v (..., nv). A state at a time is computed, so that a batch of k costs k of them,
    and backward k with their derivatives; nothing but the arrays is kept for it.

    **Numbers** have 64 bits and are on the CPU: constraints are solved to 1e-12, and arrays of 32
    bits are refused (``.double()``; in jax ``jax.config.update("jax_enable_x64", True)``).

    **Configurations** are numbers, quaternions and (cos, sin) of any length: they are normalised,
    and the gradient by q has an entry for each of its numbers, none along what is normalised away.
    `tangent_gradient` takes it to where ``pin.integrate`` steps.

    **Parameters** are those that `wrt` has named, in its order: friction and restitution (..., k)
    of each `FrictionalContact` of the scene, solref (..., 2), and inertias (..., joints, 10), in
    the order of ``pin.Inertia.toDynamicParameters``: the mass, mass times centre of mass, and the
    inertia about the joint's origin xx xy yy xz yz zz. The scene has its own where none are given.

    **First derivatives** only. torch: both modes, `torch.func.vmap`, `grad`, `jvp`, `jacrev`. jax:
    `jit`, `vmap`, `grad`, and but for whole motions `jvp` and `jacfwd`; shapes and dtypes
    are checked when jax traces. Within `jit` and `vmap` a call is a callback to the CPU, and what
    is raised there about numbers is the last line of jax's own error; elsewhere it is raised as it
    is.

    **Copies**, by ``pickle`` or ``copy.deepcopy``, are made anew from the scene, solver, integrator
    and route.
    """

    def __call__(self, q: Any, v: Any, tau: Any, *parameters: Any) -> tuple[Any, Any]:
        """Return x and y at q, v, tau and the values of the parameters that `wrt` has named."""
