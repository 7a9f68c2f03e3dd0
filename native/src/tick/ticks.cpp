// What Python sees.
#include "tick.hpp"
#include "scene_arrays.hpp"
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <algorithm>

namespace condyn
{
namespace
{
using Indices = std::vector<int>;

MatrixXd matrix(const Table & x) { return Eigen::Map<const RowMajor>(x.data(), x.shape(0), x.shape(1)); }

void want_below(const Indices & places, int count, const char * what)
{
  for (int i : places)
    want(0 <= i && i < count, what);
}

/// Tasks: `integers` are kind, size, at, hard, sizes of x_r and v_r, number of columns; `numbers` the placement,
/// kp, kd and weight.
void read_tasks(
  TickSpec & spec, const Scene & scene, const IntegerTable & integers, const Table & numbers, const Indices & columns)
{
  want(integers.shape(1) == 7 && numbers.shape(0) == integers.shape(0) && numbers.shape(1) == 15, "tasks");
  want_below(columns, scene.model.nv, "columns of a task");
  std::size_t next = 0;
  for (std::size_t i = 0; i < integers.shape(0); ++i)
  {
    const int * k = integers.data() + 7 * i;
    const double * x = row(numbers, i).data();
    want(0 <= k[0] && k[0] <= int(TaskKind::capture_point) && k[1] > 0 && k[4] > 0 && k[5] > 0 && k[6] >= 0, "task");
    Task task{TaskKind(k[0]), spec.task_rows, k[1], k[2], bool(k[3]), placement(x), x[12], x[13], x[14], {},
              spec.numbers, k[4], k[5]};
    want(next + k[6] <= columns.size() && (!k[6] || k[6] == task.size), "columns of a task");
    task.columns.assign(columns.begin() + next, columns.begin() + next + k[6]);
    next += k[6];
    const int most = task.is_force() ? int(scene.constraints.size())
                     : task.kind == TaskKind::joint ? scene.model.nq : scene.model.njoints;
    want(0 <= task.at && task.at < most, "place of a task");
    const bool joints = task.kind == TaskKind::joint || task.kind == TaskKind::posture;
    want(joints == task.is_selection(), "columns of a task");
    want(task.kind != TaskKind::posture || (task.of_x == scene.model.nq && task.of_v == scene.model.nv), "posture");
    want(task.kind == TaskKind::posture || task.of_v == task.size, "numbers of a task");
    const int turned = task.kind == TaskKind::orientation ? 9 : task.kind == TaskKind::pose ? 12 : task.size;
    const bool on_floor = task.kind == TaskKind::capture_point; // a place and the edges, two numbers each
    want(task.kind == TaskKind::posture || on_floor || task.of_x == turned, "numbers of a task");
    want(!on_floor || (task.of_x > 3 && task.of_x % 2 == 1 && task.kd > 0), "support of a task");
    const int rows = task.kind == TaskKind::pose ? 6 : task.kind == TaskKind::joint ? 1 : 3;
    want(task.kind == TaskKind::posture || task.size == rows, "rows of a task");
    want(!task.is_force() || !scene.constraints[task.at].is_scalar(), "contact of a task");
    for (int i = 0; task.is_force() && i < scene.constraints[task.at].size; ++i)
      want(std::count(spec.touching.begin(), spec.touching.end(), scene.constraints[task.at].first + i) == 1,
           "contact of a task");
    spec.task_rows += task.size, spec.numbers += task.of_x + 2 * task.of_v;
    spec.tasks.push_back(task);
  }
}

/// Cones whose axes turn: `integers` are constraint, row, column and edge.
void read_cones(
  TickSpec & spec, const Scene & scene, const Table & cones, const IntegerTable & integers, const Table & floors,
  const std::vector<Table> & A, const std::vector<Table> & to_wrench)
{
  spec.cones = matrix(cones);
  want(cones.shape(1) == spec.touching.size(), "cones");
  const std::size_t n = integers.shape(0);
  want(integers.shape(1) == 4 && floors.shape(0) == n && floors.shape(1) == 9 && A.size() == n && to_wrench.size() == n,
       "cones that turn");
  for (std::size_t i = 0; i < n; ++i)
  {
    const int * k = integers.data() + 4 * i;
    const TurningCone cone{k[0], k[1], k[2], k[3],
                           Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(row(floors, i).data()),
                           matrix(A[i]), matrix(to_wrench[i])};
    want(0 <= k[0] && k[0] < int(scene.constraints.size()) && 0 <= k[1] && 0 <= k[2] && -1 <= k[3] && k[3] < 3,
         "cone that turns");
    want(cone.A.cols() % 3 == 0 && cone.A.cols() == cone.to_wrench.rows()
           && k[1] + cone.A.rows() <= spec.cones.rows() && k[2] + cone.to_wrench.cols() <= spec.cones.cols(),
         "rows of a cone that turns");
    spec.turning.push_back(cone);
  }
}

/// Levels: how many rows each has, those of equations behind them.
void check_levels(const TickSpec & spec)
{
  want(!spec.levels.empty(), "number of levels");
  int rows = 0;
  for (int size : spec.levels)
  {
    want(0 <= size && size <= spec.task_rows - rows, "rows of a level");
    rows += size;
  }
  for (const auto & task : spec.tasks)
    want(task.hard ? task.first >= rows : task.first + task.size <= rows, "rows of a level");
}

void check(const TickSpec & spec, const Scene & scene)
{
  check_levels(spec);
  want_below(spec.held, scene.rows, "rows that are held");
  want_below(spec.touching, scene.rows, "rows of contacts");
  want_below(spec.driven, scene.rows, "rows that are driven");
  want_below(spec.motors, scene.model.nv, "motors");
  want(!spec.motors.empty(), "number of motors");
  want_below(spec.rigid, scene.model.nv, "rigid joints");
  want_below(spec.limited, int(spec.motors.size()), "motors with a limit");
  want(spec.torque.size() == Eigen::Index(spec.limited.size()), "limits of motors");
  const AccelerationLimits & a = spec.accelerations;
  want_below(a.columns, scene.model.nv, "bounds of accelerations");
  want_below(a.at_q, scene.model.nq, "limits of joints");
  want_below(a.at_v, scene.model.nv, "limits of joints");
  want(a.most.size() == scene.model.nv && a.speed.size() == scene.model.nv, "bounds of accelerations");
  const std::size_t joints = a.at_v.size();
  want(a.at_q.size() == joints && a.lowest.size() == Eigen::Index(joints) && a.highest.size() == a.lowest.size(),
       "limits of joints");
}

/// One tick into arrays of Python: v, a, tau, lam, torques of rigid joints and errors one after the other. `sides` are
/// those to begin from, and then those of the answer, level after level.
nb::tuple solve(
  Tick & tick, const List & q, const List & v, const List & passive, const List & numbers,
  const Array<signed char, 1> & sides, const Array<double, 1> & out)
{
  const TickSpec & spec = tick.spec();
  const std::size_t nv = tick.scene().model.nv;
  const std::size_t rows = spec.limited.size() + spec.accelerations.columns.size() + spec.cones.rows();
  want(q.size() == std::size_t(tick.scene().model.nq) && v.size() == nv && passive.size() == nv, "q, v or passive");
  want(numbers.size() == spec.numbers + 3 * spec.driven.size(), "references");
  want(sides.size() == rows * spec.levels.size(), "sides");
  want(out.size() == 3 * nv + tick.scene().rows + spec.rigid.size() + spec.task_rows, "answer");
  std::vector<Sides> at(spec.levels.size(), Sides(rows));
  for (std::size_t i = 0; i < sides.size(); ++i)
    at[i / rows][i % rows] = Side(std::clamp<int>(sides.data()[i], at_lower, at_upper));
  const TickSizes s = tick(vector(q), vector(v), vector(passive), numbers.data(), at);
  if (s.kkt <= spec.kkt)
  {
    for (std::size_t i = 0; i < at.size(); ++i)
      std::copy(at[i].begin(), at[i].end(), sides.data() + i * rows);
    Out(out.data(), out.size()) << tick.v(), tick.a, tick.tau, tick.lam, tick.rigid, tick.errors;
  }
  return nb::make_tuple(
    s.kkt, s.dynamics, s.constraints, s.a, s.torque, s.unreached, s.answered, s.changes, s.seconds);
}
} // namespace

} // namespace condyn

NB_MODULE(_tick, m)
{
  using namespace condyn;
  using namespace nanobind::literals;
  m.attr("protocol") = 3; // of the arrays: what condyn_pin hands over has to be of the same
  nb::class_<Tick>(m, "Tick")
    .def("__init__",
         [](Tick * self, const std::vector<std::string> & kinds, const Integers & parents, const Table & joints,
            const List & gravity, const List & armature, const IntegerTable & constraints,
            const Table & of_constraints, const List & drift, const Indices & driven, const IntegerTable & tasks,
            const Table & of_tasks, const Indices & task_columns, const Indices & levels, const Indices & held, const Indices & touching,
            const Table & cones, const IntegerTable & turning, const Table & floors, const std::vector<Table> & A,
            const std::vector<Table> & to_wrench, const Indices & motors, const Indices & rigid,
            const Indices & limited, const List & torque, const Indices & bounded, const List & most,
            const List & speed, double dt, const Indices & at_q, const Indices & at_v, const List & lowest,
            const List & highest, const List & numbers) {
           Scene scene = read_rows({kinds, parents, joints, gravity, armature, constraints, of_constraints, drift});
           TickSpec spec;
           spec.levels = levels;
           spec.held = held, spec.touching = touching, spec.driven = driven;
           spec.motors = motors, spec.rigid = rigid;
           spec.limited = limited, spec.torque = vector(torque);
           spec.accelerations = {bounded, vector(most), vector(speed), dt, at_q, at_v, vector(lowest), vector(highest)};
           want(numbers.size() == 9, "numbers");
           const double * x = numbers.data();
           spec.mass = x[0], spec.regularisation = x[1], spec.rank = x[2], spec.parallel = x[3], spec.kkt = x[4];
           spec.least = x[5], spec.strictly = x[6], spec.slack = x[7], spec.decided = x[8];
           read_tasks(spec, scene, tasks, of_tasks, task_columns);
           read_cones(spec, scene, cones, turning, floors, A, to_wrench);
           check(spec, scene);
           new (self) Tick(std::move(scene), std::move(spec));
         },
         nb::kw_only(), "kinds"_a, "parents"_a, "joints"_a, "gravity"_a, "armature"_a, "constraints"_a,
         "of_constraints"_a, "drift"_a, "driven"_a, "tasks"_a, "of_tasks"_a, "task_columns"_a, "levels"_a, "held"_a, "touching"_a,
         "cones"_a, "turning"_a, "floors"_a, "A"_a, "to_wrench"_a, "motors"_a, "rigid"_a, "limited"_a, "torque"_a,
         "bounded"_a, "most"_a, "speed"_a, "dt"_a, "at_q"_a, "at_v"_a, "lowest"_a, "highest"_a, "numbers"_a)
    .def("solve", &solve, "q"_a, "v"_a, "passive"_a, "numbers"_a, "sides"_a, "out"_a);
}
