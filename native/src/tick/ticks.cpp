// What Python sees.
#include "tick.hpp"
#include "scene_fields.hpp"
#include <algorithm>

namespace condyn
{
namespace
{
void want_below(const std::vector<int> & places, int count, const char * what)
{
  for (int i : places)
    want(0 <= i && i < count, what);
}
} // namespace

void fill(const Fields & x, Task & to)
{
  to.kind = TaskKind(place_of(
    x.get<std::string>("kind"),
    {"position", "orientation", "pose", "center of mass", "joint", "posture", "angular momentum", "contact force",
     "capture point"}, "kind of a task"));
  x("size", to.size)("at", to.at)("hard", to.hard)("placement", to.placement)("kp", to.kp)("kd", to.kd);
  x("weight", to.weight)("columns", to.columns)("of_x", to.of_x)("of_v", to.of_v);
}

void fill(const Fields & x, TurningCone & to)
{
  x("constraint", to.constraint)("row", to.row)("column", to.column)("edge", to.edge)("floor", to.floor);
  x("A", to.A)("to_wrench", to.to_wrench);
}

void fill(const Fields & x, AccelerationLimits & to)
{
  x("columns", to.columns)("most", to.most)("speed", to.speed)("dt", to.dt)("at_q", to.at_q)("at_v", to.at_v);
  x("lowest", to.lowest)("highest", to.highest);
}

void fill(const Fields & x, TickSpec & to)
{
  x("tasks", to.tasks)("levels", to.levels)("held", to.held)("touching", to.touching)("driven", to.driven);
  x("motors", to.motors)("rigid", to.rigid)("limited", to.limited)("torque", to.torque);
  x("accelerations", to.accelerations)("cones", to.cones)("turning", to.turning)("mass", to.mass);
  x("regularisation", to.regularisation)("rank", to.rank)("parallel", to.parallel)("kkt", to.kkt)("least", to.least);
  x("strictly", to.strictly)("slack", to.slack)("decided", to.decided);
}

namespace
{
/// Checks tasks, and counts their rows and numbers.
void place_tasks(TickSpec & spec, const Scene & scene)
{
  for (Task & task : spec.tasks)
  {
    task.first = spec.task_rows, task.reference = spec.numbers;
    want(task.size > 0 && task.of_x > 0 && task.of_v > 0, "task");
    want_below(task.columns, scene.model.nv, "columns of a task");
    want(task.columns.empty() || int(task.columns.size()) == task.size, "columns of a task");
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
  }
}

void check_cones(const TickSpec & spec, const Scene & scene)
{
  want(spec.cones.cols() == Eigen::Index(spec.touching.size()), "cones");
  for (const TurningCone & cone : spec.turning)
  {
    want(0 <= cone.constraint && cone.constraint < int(scene.constraints.size()) && 0 <= cone.row && 0 <= cone.column
           && -1 <= cone.edge && cone.edge < 3, "cone that turns");
    want(cone.A.cols() % 3 == 0 && cone.A.cols() == cone.to_wrench.rows()
           && cone.row + cone.A.rows() <= spec.cones.rows() && cone.column + cone.to_wrench.cols() <= spec.cones.cols(),
         "rows of a cone that turns");
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
  check_cones(spec, scene);
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

/// Where an answer has its parts.
nb::dict parts(const Tick & tick)
{
  const std::size_t nv = tick.scene().model.nv, rows = tick.scene().rows, errors = tick.spec().task_rows;
  return parts_of(
    {{"v", nv}, {"a", nv}, {"tau", nv}, {"lam", rows}, {"rigid", tick.spec().rigid.size()}, {"errors", errors}});
}

/// One tick into an array of Python, whose `parts` are one after the other. `sides` are those to begin from, and then
/// those of the answer, level after level.
TickSizes solve(
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
  const TickSizes s = tick(
    In(q.data(), q.size()), In(v.data(), nv), In(passive.data(), nv), numbers.data(), at);
  if (s.kkt <= spec.kkt)
  {
    for (std::size_t i = 0; i < at.size(); ++i)
      std::copy(at[i].begin(), at[i].end(), sides.data() + i * rows);
    Out(out.data(), out.size()) << tick.v(), tick.a, tick.tau, tick.lam, tick.rigid, tick.errors;
  }
  return s;
}
} // namespace

} // namespace condyn

NB_MODULE(_tick, m)
{
  using namespace condyn;
  using namespace nanobind::literals;
  m.attr("protocol") = 4; // of the fields that cross the border: condyn_pin has to be of the same
  nb::class_<TickSizes>(m, "TickSizes")
    .def_ro("kkt", &TickSizes::kkt)
    .def_ro("dynamics", &TickSizes::dynamics)
    .def_ro("constraints", &TickSizes::constraints)
    .def_ro("a", &TickSizes::a)
    .def_ro("torque", &TickSizes::torque)
    .def_ro("unreached", &TickSizes::unreached)
    .def_ro("answered", &TickSizes::answered)
    .def_ro("changes", &TickSizes::changes)
    .def_ro("seconds", &TickSizes::seconds);
  nb::class_<Tick>(m, "Tick")
    .def("__init__",
         [](Tick * self, const nb::kwargs & given) {
           const Fields x(given);
           Scene scene = read_rows(x);
           TickSpec spec = x.as<TickSpec>();
           place_tasks(spec, scene);
           check(spec, scene);
           new (self) Tick(std::move(scene), std::move(spec));
         })
    .def_prop_ro("parts", &parts)
    .def("solve", &solve, "q"_a, "v"_a, "passive"_a, "numbers"_a, "sides"_a, "out"_a);
}
