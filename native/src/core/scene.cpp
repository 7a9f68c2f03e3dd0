#include "scene.hpp"
#include "want.hpp"

namespace condyn
{
void add_constraints(
  Scene & scene, const std::vector<Constraint> & constraints, const std::vector<PlainSpec> & plain)
{
  const Model & model = scene.model;
  const auto valid = [&](int j) { return 0 <= j && j < model.njoints; };
  for (const auto & c : constraints)
  {
    want(c.first == scene.rows && c.size > 0, "rows of a constraint");
    want(c.size == (c.is_scalar() ? 1 : int(c.selection.size())), "rows of a constraint");
    want(c.kind != Kind::ball || c.size == 3, "rows of a constraint");
    want(c.kind != Kind::weld || c.size == 6, "rows of a constraint");
    want((c.is_hinge || c.is_cross() ? 0 : -1) <= c.axis && c.axis < 3 && c.other_axis < 3, "axis of a constraint");
    want(!c.is_cross() || (c.kind == Kind::cut && c.size == 4), "rows of a constraint");
    if (c.kind == Kind::coupling)
      want(0 <= std::min(c.q_a, c.q_b) && std::max(c.q_a, c.q_b) < model.nq
             && 0 <= std::min(c.v_a, c.v_b) && std::max(c.v_a, c.v_b) < model.nv, "coordinates of a coupling");
    else
      want(valid(c.joint1) && valid(c.joint2), "joints of a constraint");
    for (int row : c.selection)
      want(0 <= row && row < 6, "selection of a constraint");
    want(c.joint2 == 0 || c.kind != Kind::roll, "joints of what rolls");
    // a blade belongs everywhere; of edges, points and welds on the world one has a place
    if (!c.anchored && (c.kind != Kind::held || c.size > 1))
      scene.unanchored.push_back(int(scene.constraints.size()));
    scene.constraints.push_back(c);
    scene.rows += c.size;
  }
  for (const auto & c : plain)
  {
    want(valid(c.joint1) && valid(c.joint2), "joints of a constraint");
    want(c.size == 3 || c.size == 6, "rows of a constraint of Pinocchio");
    Rigid made(
      c.size == 6 ? pinocchio::CONTACT_6D : pinocchio::CONTACT_3D, model, c.joint1, c.placement1, c.joint2,
      c.placement2, pinocchio::LOCAL);
    made.m_baumgarte_parameters.Kp = c.anchored ? scene.kp : 0.0;
    made.m_baumgarte_parameters.Kd = scene.kd;
    if (!c.anchored)
      scene.unanchored_plain.push_back(int(scene.plain.size()));
    scene.plain.push_back(made);
    scene.plain_specs.push_back(c);
    scene.plain_rows += c.size;
  }
  const bool same = scene.to_scene.size() == 0;
  want(same ? scene.rows == scene.plain_rows || plain.empty()
            : scene.to_scene.rows() == scene.rows && scene.to_scene.cols() == scene.plain_rows,
       "to_scene");
}
} // namespace condyn
