// What does not fit is said, and goes no further.
#pragma once
#include <stdexcept>
#include <string>

namespace condyn
{
inline void want(bool fits, const char * what)
{
  if (!fits)
    throw std::invalid_argument(std::string(what) + " does not fit the scene");
}
} // namespace condyn
