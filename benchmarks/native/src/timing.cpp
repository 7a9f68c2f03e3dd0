#include "timing.hpp"

#include <algorithm>
#include <chrono>

namespace condyn
{
namespace
{

using Clock = std::chrono::steady_clock;

double timed_call(Method & method, const State & state, const State & other)
{
  method.prepare(other);
  method.run(other);
  method.prepare(state);
  const auto start = Clock::now();
  method.run(state);
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

Times summarise(std::vector<double> us)
{
  std::sort(us.begin(), us.end());
  const auto quantile = [&](double fraction) {
    return us[static_cast<std::size_t>(fraction * static_cast<double>(us.size() - 1))];
  };
  return {quantile(0.5), quantile(0.95), us.front()};
}

} // namespace

std::vector<Times>
time_in_turns(const std::vector<MethodPtr> & methods, const State & state, int repeats)
{
  State other = state;
  other.tau.array() += 1.;

  const int warm_up = std::max(repeats / 10, 1);
  std::vector<std::vector<double>> us(methods.size());
  for (int round = -warm_up; round < repeats; ++round)
    for (std::size_t i = 0; i < methods.size(); ++i)
    {
      const double elapsed = timed_call(*methods[i], state, other);
      if (round >= 0)
        us[i].push_back(elapsed);
    }

  std::vector<Times> times;
  for (const auto & samples : us)
    times.push_back(summarise(samples));
  return times;
}

} // namespace condyn
