"""Tolerances of solutions, states and models, each with its reason."""

from __future__ import annotations

from typing import Final

# A status is ok when the bound on the error of a, relative to the size of a, is below this, unless
# the caller says otherwise. It is what the agreement of the solvers with Reference is promised to.
SOLVED: Final = 1e-8

# What constraint forces do to the joints, J^T lam, relative to the largest torque in the equation
# of a joint: forces of an answer that is ok are right to this. Ten times SOLVED: J^T lam is what
# is left of M a + h - tau, where torques of heavy bodies cancel.
FORCES: Final = 1e-7

# No finer accuracy can be asked for: the residuals themselves are rounded to about this.
FINEST: Final = 1e-14

# | |quaternion| - 1 |. Pinocchio's answer is off by about the same relative amount without any
# sign of it; integration in double precision denormalises by 1e-16 a step, so 1e-6 is never met
# by accident, and a quaternion typed with six digits is refused.
QUATERNION: Final = 1e-6

# | R Rᵀ - 1 | of the rotation in a placement. Products of rotations end at 1e-15, and the nearest
# rotation of a matrix typed with twelve digits is found before it comes here.
ROTATION: Final = 1e-9

# Violation of a closed loop [m, rad]. Newton's method ends at rounding, 1e-16 times the
# size of the robot; a state written to a file with twelve digits is still accepted.
CLOSED: Final = 1e-10

# Violation from which on a state counts as open [m, rad]: the gap tells redundant rows from others
# there (`constraints.rows.redundancy`). Loops that were assembled, or are kept closed in motion,
# are at 1e-15 to 1e-12, and REFERENCE_RANK is rounding beside them.
OPEN: Final = 0.1 * CLOSED

# Violation that is no rounding [m, rad], nor |J v| [m/s, rad/s]: near a singular posture the answer
# to such a state is looked at, for it may be that of the gap. Exact states leave 1e-17 to 1e-15.
NOT_ROUNDING: Final = 1e-14

# The same where rows are factorised anyway, and to look at the gap costs little: below it redundant
# rows are below REFERENCE_RANK, also in loops of a millimetre.
AJAR: Final = 1e-13

# Geometry of models that are built in Python: products of rotations and placements, rounded.
ROUNDED_GEOMETRY: Final = 1e-11

# Geometry of files, which write angles and lengths with five digits at least: 1.5708 for pi/2 is
# off by 3.7e-6.
WRITTEN_GEOMETRY: Final = 1e-5

# Singular values, relative to the largest of scaled rows, that may be digits of a file, and gaps
# that they may leave: the smallest useful values of twelve machines are at 1.3e-2, 1.57 for pi/2
# makes up 2e-4.
LEAST_PRECISE: Final = 1e-3

# Length of the move that closes the loops, over the smallest pivot that is kept [1]: the distance
# to where the rank falls. Below 0.1, a was off by up to 20 % in 95 of 100 states, above 0.5 by all
# of itself: there no acceleration belongs to the state.
DOUBT: Final = 0.1

# Of these an error names the least that would let its answer pass.
ADVISED_ACCURACIES: Final = tuple(float(f"1e{digit}") for digit in range(-14, 0))

# Violation at which a path that is driven counts as one that the loops cannot follow, and a step as
# one that they cannot be closed behind [m, rad]: what drift leaves open in a run that is worth
# looking at is far below, and what leads out of reach opens them by as much within milliseconds.
OUT_OF_REACH: Final = 1e-2

# Error of a target that an inverse kinematics has met, of a length relative to the longest link, of
# an angle in rad: Newton's method passes from 1e-5 to 1e-10 in one step, and rounding is 1e-13.
TARGET: Final = 1e-9

# Distance of a target, relative to the longest link, from which on it is refused: of what a link of
# the robot moves it by, squares of such distances keep seven digits, and none at 1e16.
FAR: Final = 1e9

# Violation of a loop at which a velocity is still projected [m, rad]: J of a loop open by
# g is off by about g over a lever of 0.1 m or more, so velocities by per mille. Simulations are
# kept below.
NEARLY_CLOSED: Final = 1e-4

# Gap of a contact that an event brings in the middle of a motion [m, rad]: steps of fast falls
# leave as much of the one before in its place, and to push it out takes five steps.
NEARLY_APART: Final = 1e-3

# Violation of a loop where a file draws its model [m, rad]: files are written with six
# digits. A larger one is told to the user, for the file may mean another place.
DRAWN: Final = 1e-6

# A corner is still over a face, and edges still cross, when they are beside each other by this
# share of the size of a shape: of boxes that stand flush on each other every corner is on an edge.
ON_FACE: Final = 1e-9

# Sharp corners that are nearer to an edge or a corner than this have no derivative of their normal,
# which turns by 1 rad in as much [m].
SHARP: Final = 1e-6

# A corner belongs to a face of a solid if it is off its plane by no more than this share of the
# size, and edges are parallel whose ends part by no more: files write corners with six digits.
FLAT: Final = 1e-6

# Points of one contact that are nearer to each other than this share of the size of a shape are
# one: flush boxes name each corner up to four times.
ONE_POINT: Final = 1e-6

# What separates two solids along a pair of edges has to be more than along a face by this share of
# their size. Flat on each other both are the same to rounding, and a face has all four points.
EDGE_ON: Final = 1e-6

# Cosine between the normal of two edges that cross and the axis of the contact: below it the edges
# pass each other sideways, and a face or a corner touches first.
CROSSING: Final = 0.7

# Two engines on one robot, relative. A file of ours says all digits and agrees to 1e-12; files are
# written with six, and MuJoCo's compiler finds principal axes of inertia to 1e-7.
ENGINES: Final = 1e-6

# Rank of the whitened constraint Jacobian, relative to its largest singular value. Redundant rows
# of an assembled loop are at 1e-15, those of a loop open by CLOSED at 1e-10; the smallest useful
# ones met in robots are at 1e-3.
RANK: Final = 1e-7

# Rates of contact rows that constraints hold, and do not drive [m/s, rad/s]: rounding of s', which
# is a few metres a second, and far below any slip that has a direction.
NOT_DRIVEN: Final = 1e-12

# Where a run of MINRES ends and the next begins: its residual in the norm of the preconditioner,
# relative to the first. Half the digits of a double; below, the residual that is carried along
# drifts from the real one. From 1e-4 to 1e-12 all runs together take about as many iterations.
RUN_OF_MINRES: Final = 1e-7

# The same for Reference, which is called at states on the manifold and has to see what is nearly
# singular as what it is.
REFERENCE_RANK: Final = 1e-11

# What rounding of J makes of singular values that are zero, as a multiple of eps |P w|
# (`algebra.minimum_norm`). Up to 7 in trees of eight joints with masses over nine decades: sums
# along the tree round more than once.
BLURRED: Final = 16.0

# Reciprocal condition number of the KKT matrix, rows and columns scaled to one. Cassie with
# independent rows has 1e-8; a redundant row gives 1e-17.
SINGULAR: Final = 1e-13

# Derivatives against central differences, relative to the largest entry of the block. Differences
# of the fourth order reach 1e-10 on robots; a missing term is wrong by per cents.
DERIVATIVES: Final = 1e-6

# M is refused when a joint feels less inertia than this share of the largest that a joint of its
# kind, one that turns or one that shifts, feels.
MASSLESS: Final = 1e-14

# A notice of an answer that is not ok names joints that together feel less than this share of the
# inertia that each of them feels: the rounding of M alone, 1e-16, is then 1e-8 of a.
NEARLY_MASSLESS: Final = 1e-8

# A scene is measured at a state where joints that may move no inertia elsewhere feel this share of
# what they feel with all else locked: bounds of errors elsewhere are too large by 1e3 at most.
WELL_MOVED: Final = 1e-3

# The largest number in a model or a constraint: m L^2 is 1e150 then, and its square still a number.
# No machine has a larger one, in any units. An inertia below HUGE^-3 has no inverse.
HUGE: Final = 1e50

# The smallest mass of a body that is not zero [kg]. Where Pinocchio puts bodies together it divides
# by their mass, or by this if it is less: centres of mass, and with them M, are silently wrong.
LIGHTEST: Final = 2.0**-52

# A principal moment that is negative by less, relative to the largest of the body, is zero but for
# the digits of the file, and so is what a moment exceeds the sum of the other two by.
MOMENT: Final = 1e-6

# A chain stands in a dead point when its smallest singular value is below this share of the
# largest, and columns of J that differ by less count as dependent. A gap of CLOSED shifts a joint
# beside a dead point by its square root, 1e-5.
DEAD_POINT: Final = 1e-6

# Columns whose norms differ by less, relative, are equal, and their place decides which is taken.
# Rounding changes a null space by eps / RANK = 2e-9 at most, nearly always by 1e-15; the two legs
# of Cassie, by the digits of its file, differ by 2e-8.
TIED: Final = 1e-6

# Loops that close at one configuration only, such as bars that just reach, are found no nearer than
# the square root of a gap: for one of CLOSED, 1e-5 [rad, m]. Joints that are this near to each
# other are at the same place, and smaller singular values, relative to the largest, are zeros.
ISOLATED: Final = 1e-4

# What the Lie brackets of allowed velocities leave in the rows, relative to the largest derivative
# of a row. In loops and contacts its terms cancel to 3e-16, and to 1e-10 at worst where a loop is
# open by CLOSED; a wheel or a blade leaves its lever as a share of the robot: 0.1 to 1 in ours.
INTEGRABLE: Final = 1e-8

# How far a Lie bracket by differences has to lead out of those before, relative to its size or 1.
# Differences of order 4 leave 1e-8 of it a level; of cars and trailers brackets lead out by 0.1 on.
GROWN: Final = 1e-5

# |J v| of a velocity that is consistent, relative to |v| or 1, whichever is larger [m/s, rad/s].
# Projection ends at 1e-15; a velocity written to a file with twelve digits is still accepted.
CONSISTENT: Final = 1e-10

# Sine of the angle between two axes of a description that are meant to be the same. Files write
# angles with four digits, and 1.57 for a right angle, which is off by 8e-4.
PARALLEL: Final = 1e-3

# Error of a smaller scene that counts as none. Exact simplifications differ from the full scene by
# what two solves by `Reference` without corrections do: up to 3e-13 on Cassie.
EXACT: Final = 1e-9

# Energy that comes or goes without work in a simulation, relative to what is exchanged: what is
# larger is told to the user. A pendulum by Runge-Kutta 4 and 1 ms has 1e-9, by Euler's 1e-3.
BALANCED: Final = 1e-2

# The same, from which on a motion is not ok. A light cart under a heavy pendulum, whose steps miss
# its fast turns, loses a third in 3 s and goes on as another machine.
UNBALANCED: Final = 0.1

# Gap or depth that a motion may leave and still be ok, relative to the size of the machine: a
# millimetre of a metre. Schemes that resolve a motion leave 1e-6 of it and less.
LEFT_OPEN: Final = 1e-3

# Estimated error of a motion that is told to the user, relative to how far bodies moved. RATTLE
# with 0.1 rad a step has 1e-3 after a second of a four-bar, 0.1 of a heavy top of 200 rad/s.
OFF: Final = 1e-2

# The same relative to the size of the machine: the error of what hardly moves matters little.
HARDLY_OFF: Final = 1e-4

# The same relative to the energy itself, for motions that exchange next to nothing: a ball that
# rolls for 4 s by Runge-Kutta 4 and 1 ms has 1.3e-10. Also in metres: what lifts the robot by that.
ENERGY_KEPT: Final = 1e-9

# An answer in other units of length, mass and time, converted back, relative to the largest |a|.
# Powers of two leave every digit of the equations, so that most methods agree to the last bit; what
# a scene measures at its nominal state has loops that close to rounding, and that is not the same
# in another unit of length: 2e-15 in DenseKKT on Delta, 7e-14 in Proximal on Cassie.
OTHER_UNITS: Final = 1e-12

# The same for methods that a scene tells how accurate to be. ok is relative to the larger of |a|
# and gravity, numbers in rad/s^2 and m/s^2: where lengths are larger numbers, ConjugateGradient
# and LCABA may stop earlier, 2e-10 and 2e-9 from the other answer. And LCABA chooses its weight by
# states that move at 1 rad/s, which is less beside gravity where times are smaller numbers: 5e-9.
# An answer that is ok is within SOLVED.
OTHER_CHOICE: Final = SOLVED

# |G - G^T| of a contact problem, relative to the largest entry. Products J M^-1 J^T are symmetric
# to 1e-15, and to 1e-11 where masses are wide apart; a wrong one is off by per cents.
SYMMETRIC: Final = 1e-9

# Natural map of a contact problem that counts as solved, in units of its own impulses: what the
# landed contact solvers reach on robots without a second method.
CONTACT_SOLVED: Final = 1e-8

# Natural map that modes are read at for derivatives: Newton's method ends below it, and a contact
# that slides by more than a hundred times as much does slide.
CONTACT_POLISHED: Final = 1e-12

# What is so near to another mode has one-sided derivatives: both of a complementary pair are below
# it, impulses and velocities as shares of the largest velocity of the contact problem and of g dt.
# Differences over 1e-6 of these scales would see both sides; impulses are polished to 1e-12.
SWITCHES: Final = 1e-6

# Values of an analytic formula against their mean on a circle, relative to the largest of them: a
# sine of 40 rad/s is at 3e-9 with the default radius, abs within a second of its kink at 1e-4.
ANALYTIC: Final = 1e-6

# Torques of a function that is asked again for a state of its motion, relative to the largest: the
# same to the bit, but where it rounds otherwise on a second thread.
SAME_TORQUES: Final = 1e-9

# Gap of a contact without a force that is on its plane beside others that carry [m]. Corners of a
# sole that stands are off by 1e-8, the square of what a step turns it by; one that tips is off by
# 1e-5 and more in its first millisecond.
TOUCHES: Final = 1e-6

# The largest coefficient of friction in a contact problem. mu |sigma_t| is added to sigma_n: a slip
# too slow to count hides that bodies fall in mu times as fast. A step of Talos on two edges is off
# by 1e-6 m/s at 1e4, by 1e-4 at 1e6, and the natural residual is small.
MOST_FRICTION: Final = 1e3

# Friction that counts as none: of a load of 9.81 m/s^2 it leaves what KKT allows, and cones so thin
# have no inside for solvers of quadratic programs.
FRICTIONLESS: Final = 1e-10

# Eigenvalues of G, rows and columns scaled to one, that count as zero, relative to the largest: its
# factor J L^-T then has singular values below 1e-6. Four corners of a box leave 1e-16, and the
# smallest useful ones of robots on their feet are 1e-5.
CONTACT_RANK: Final = 1e-12

# |G z| of impulses that take g . z = -1 from a contact problem, both normalised: what is below
# proves that no impulse closes the contacts. Rows that contradict each other leave 1e-16.
CERTIFICATE: Final = 1e-10

# KKT residual of a quadratic program whose answer counts: what it demands of accelerations, and of
# forces over the mass of the robot [m/s^2], beside gravity; of the gradient relative to its size.
# A polished answer has 1e-13 to 1e-11, where weights of tasks are eight decades apart.
KKT: Final = 1e-9

# What rows of a program have to give before they count as contradicting each other [m/s^2]. HiGHS
# satisfies rows to 1e-7.
GIVES: Final = 1e-6

# Pivot of an equation, relative to its size, by a Cholesky factorisation of the products of rows:
# its rounding, 1e-16, is squared there. Above it all rows are independent; below they are looked at
# by pivots that are not squared.
INDEPENDENT: Final = 1e-6

# What accelerations of a robot without gravity are compared with, where they are smaller [m/s^2].
GRAVITY: Final = 9.81

# How far points of contacts are off a plane that counts as theirs [m]: floors are no flatter, and
# the soles of Talos, as its file has them, lean by 2e-3 rad. A centre so
# near to the edge of the support is on it.
COPLANAR: Final = 1e-3

# Change of a, relative to the larger of |a| and gravity, from which on a notice says that tau lacks
# the springs and dampers of the robot: friction of bearings that nobody models is as large.
LEFT_OUT_OF_TAU: Final = 1e-2

# How deep a collision shape of the robot's file may be in the ground of a scene, unsaid [m]: meshes
# of files are no truer. A body with contacts of its own may be deeper: points that stand for feet
# are in their middle, 30 mm above the ground that ANYmal's balls would touch.
IN_THE_GROUND: Final = 1e-3
FEET_IN_THE_GROUND: Final = 4e-2
