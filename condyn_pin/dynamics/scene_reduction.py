"""The methods of a scene that return a smaller one.

Each is found by a module of `mechanism.reduction`, which stands above: it is imported when it is
called.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, cast

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.dynamics.solvers.base import Solver
    from condyn_pin.mechanism.reduction.minimal_report import Minimal
    from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene


class Smaller:
    """What a scene can leave out; `Scene` is the only class of this kind."""

    @property
    def _scene(self) -> Scene:
        return cast("Scene", self)

    def lock(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene of the smaller robot in which some joints are held at q.

        Exact: it moves as this one does with the joints welded.

        Parameters
        ----------
        joints : sequence of str
            A free-flyer may be among them. Joints coupled to them are locked too, where the
            couplings want them.
        q : (nq,) array_like, optional
            Where; the nominal state by default. The other joints move as closing the loops needs;
            the closed configuration, without the locked joints, is the first posture of the smaller
            robot, ``locked``.

        Returns
        -------
        ReducedScene
            A scene; its `expand_state` and `reduce_state` lead back and forth, and `dropped` says
            what is left out, such as loops whose two sides are one body now.

        Raises
        ------
        NotAssembled
            If the loops cannot be closed with the joints there.
        """
        from condyn_pin.mechanism.reduction.reduction import lock

        return lock(self._scene, joints, q)

    def keep(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene with all but some joints locked, as by `lock`.

        A free-flyer is kept without being named; `lock` holds it.
        """
        from condyn_pin.mechanism.reduction.reduction import keep

        return keep(self._scene, joints, q)

    def without(self, names: Sequence[str]) -> ReducedScene:
        """Return the scene without some of its constraints."""
        from condyn_pin.mechanism.reduction.reduction import without

        return without(self._scene, names)

    def without_bodies(self, joints: Sequence[str]) -> ReducedScene:
        """Return the scene without the bodies that hang on some joints, their mass included.

        What hangs on these bodies goes with them, and the constraints that are fixed to them.
        """
        from condyn_pin.mechanism.reduction.reduction import without_bodies

        return without_bodies(self._scene, joints)

    def merge_points(self, *, edges: bool = True) -> ReducedScene:
        """Return the scene with the points on each frame merged into an edge or a surface: exact.

        Only points without an anchor: they say nothing about where the body is, so nothing is lost.
        The merged contact has the name of the frame, or ``frame/edge``, an edge being on a new
        frame; with a number behind it if that name is another's.

        Parameters
        ----------
        edges : bool
            Merge points on a line too. Solvers that know no edges make two points of it again.
        """
        from condyn_pin.mechanism.reduction.merging import merge_points

        return merge_points(self._scene, edges=edges)

    def as_planar(self, name: str) -> ReducedScene:
        """Return the scene in which a ball loop says nothing across the plane of its linkage.

        Exact: of the three rows of such a ball, two are independent.

        Parameters
        ----------
        name : str
            Of the loop.

        Raises
        ------
        UnknownName
            If there is no such constraint.
        InvalidConstraint
            If the loop is no ball, or its rows have another rank than 2.
        """
        from condyn_pin.mechanism.reduction.planar import as_planar

        return as_planar(self._scene, name)

    def rods_as_distances(
        self, joints: Sequence[str], *, mass: Literal["ends", "drop"] = "ends"
    ) -> ReducedScene:
        """Return the scene in which rods are one row each: the distance of their two ends.

        Parameters
        ----------
        joints : sequence of str
            The joints on which the rods hang: balls, or hinges of a planar linkage. Each rod ends
            a branch, and one loop of kind ball or planar ties its other end.
        mass : {"ends", "drop"}
            Whether a rod's mass is shared by its two ends, so that total mass and centre of mass
            along the rod stay, or dropped.

        Raises
        ------
        InvalidArgument
            If a body is no rod; the text says why.
        InvalidConstraint
            If a rod does more than keep a distance: without it the mobility is another.
        """
        from condyn_pin.mechanism.reduction.rods import rods_as_distances

        return rods_as_distances(self._scene, joints, mass=mass)

    def without_linkage(self, loops: Sequence[str], joints: Sequence[str]) -> ReducedScene:
        """Return the scene without a linkage that only follows another joint.

        Its loops are left out and its bodies welded at the nominal state; their inertia and damping
        are reflected onto the joints that they followed, as armature and damping.

        Parameters
        ----------
        loops : sequence of str
            Names of constraints.
        joints : sequence of str
            The joints of the linkage.

        Raises
        ------
        InvalidArgument
            If a motor or a spring acts on one of the joints.
        InvalidConstraint
            If the loops also hold other joints than these.
        """
        from condyn_pin.mechanism.reduction.linkages import without_linkage

        return without_linkage(self._scene, loops, joints)

    def minimal(
        self,
        *,
        error: float,
        motion: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None,
        watch: Sequence[str] | None = None,
        solver: Solver | None = None,
    ) -> Minimal:
        """Return a smaller scene that answers the same question within an error.

        Tried in this order, each kept if the errors stay within the limit: joints that do not move
        are locked, points of contact merged, implied constraints left out, linkages that only
        follow reflected onto what they follow, rods replaced by distances, balls of planar
        linkages by planar pins.

        Parameters
        ----------
        error : float
            Largest relative error of accelerations and contact wrench that is allowed
            (`condyn_pin.mechanism.reduction.price`). Zero allows only what is exact, to 1e-9.
        motion : sequence of (q, v, tau), optional
            Closed states that matter, by which everything is judged. By default random ones, in
            which every joint moves: some to choose by, 50 others to judge by.
        watch : sequence of str, optional
            Joints whose accelerations are asked for; by default the floating base and the motors
            that the motion moves, or all that it moves if it moves neither.
        solver : Solver, optional
            What has to take the smaller scene, and is timed; by default that of `solve`. Proximal()
            takes neither distances nor planar pins, DenseKKT() does.

        Returns
        -------
        Minimal
            The scene, sizes and times before and after, the errors, and every step in words.

        Raises
        ------
        NotAssembled
            If a state of the motion is not on the constraints; the text says which.
        """
        from condyn_pin.mechanism.reduction.minimal import minimal

        return minimal(self._scene, error=error, motion=motion, watch=watch, solver=solver)
