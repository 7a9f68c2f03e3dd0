// Who answers the states of a scene.
#pragma once
#include "direct.hpp"
#include "proximal.hpp"
#include <memory>

namespace condyn
{
/// A solver of the scene, which has to stay where it is.
inline std::unique_ptr<Solver> solver_of(const Scene & scene)
{
  if (scene.method == Method::proximal)
    return std::make_unique<Proximal>(scene);
  return std::make_unique<Direct>(scene);
}
} // namespace condyn
