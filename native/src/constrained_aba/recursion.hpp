// What both recursions of pv.hpp share: the way out along the tree, and what contacts lack there.
//
// Pinocchio's passes over the joints are used as they are; the functions that call them,
// `pinocchio::pv` and `pinocchio::constrainedABA` of 3.9, are not:
//   - constrainedABA takes the residual of its first iteration from accelerations that the call
//     before has left, and never forgets one that is not a number;
//   - it adds the weight of each contact of a body once for every contact of that body;
//   - both take Baumgarte's errors from the call before, and the placements from none;
//   - neither counts iterations, and pv does not look whether its factor exists.
#pragma once

#include "method.hpp"

#include <pinocchio/algorithm/pv.hpp>

namespace condyn
{

class Recursion : public Method
{
public:
  Recursion(const Scene & scene, const Settings & settings);

protected:
  using Forward = pinocchio::PvForwardStep1<double, 0, Joints, In, In>;

  /// One contact: where its rows are in lam, and its columns in what its joint holds.
  struct Contact
  {
    std::size_t index; // among the constraints
    pinocchio::JointIndex joint;
    int row, column, size;
    Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, 6> K; // J = K^T S for the joint's own motion
  };

  /// v, biases and the force of each body as if alone; then what each contact lacks without any
  /// acceleration, gamma - a_ref, is in `lack`.
  void out_along_the_tree(const In & q, const In & v, const In & tau);

  Data data;
  std::vector<Contact> contacts;
  VectorXd lack;

private:
  void place(pinocchio::JointIndex joint);
  pinocchio::Motion reference(const Contact & contact) const;

  bool placed; // whether drift control asks where bodies are
};

} // namespace condyn
