// Work on many rows by some threads, while Python may be interrupted.
#pragma once
#include <nanobind/nanobind.h>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <vector>

namespace condyn
{
/// Calls work(worker, i) for all i < n; who is free takes the next few. To be called without the GIL.
/// Without threads the calling one does it, and where the system starts fewer, those do it.
///
/// The calling thread looks for signals: after one, no further row is begun, `stop` says so to the
/// rows in work, and the exception of Python is thrown. `work` may throw nothing.
template<typename Work>
void share(std::size_t n, int threads, std::atomic<bool> & stop, Work work)
{
  const auto alone = [&] {
    for (std::size_t i = 0; i < n; ++i)
      work(0, i);
  };
  threads = int(std::min(std::size_t(threads), n));
  if (threads == 0)
    return alone();
  std::atomic<std::size_t> next{0};
  const std::size_t chunk = std::max<std::size_t>(1, std::min<std::size_t>(64, n / (8 * threads)));
  std::mutex mutex;
  std::condition_variable ended;
  int running = 0;
  const auto take = [&](int worker) {
    for (std::size_t begin; !stop && (begin = next.fetch_add(chunk)) < n;)
      for (std::size_t i = begin; !stop && i < std::min(begin + chunk, n); ++i)
        work(worker, i);
    // notified while locked: the waiting thread may not leave before
    const std::lock_guard<std::mutex> lock(mutex);
    --running;
    ended.notify_one();
  };
  std::vector<std::thread> workers;
  workers.reserve(threads);
  for (int worker = 0; worker < threads; ++worker)
    try
    {
      const std::lock_guard<std::mutex> lock(mutex);
      workers.emplace_back(take, worker);
      ++running;
    }
    catch (const std::system_error &) // no more of them
    {
      break;
    }
  if (workers.empty())
    return alone();
  bool interrupted = false;
  {
    std::unique_lock<std::mutex> lock(mutex);
    while (!ended.wait_for(lock, std::chrono::milliseconds(50), [&] { return running == 0; }))
    {
      lock.unlock();
      {
        nanobind::gil_scoped_acquire held;
        interrupted = interrupted || PyErr_CheckSignals() != 0;
      }
      if (interrupted)
        stop = true;
      lock.lock();
    }
  }
  for (auto & each : workers)
    each.join();
  if (interrupted)
  {
    nanobind::gil_scoped_acquire held;
    throw nanobind::python_error();
  }
}

/// work(worker, i, stop) for all rows, by some threads: `done` of each, zero before, is what that returns. A row that
/// throws is left to Python, which says why.
template<typename Done, typename Work>
void share_rows(const Done & done, int threads, Work work)
{
  std::atomic<bool> stop{false};
  nanobind::gil_scoped_release released;
  share(done.size(), threads, stop, [&](int worker, std::size_t i) {
    try
    {
      done.data()[i] = work(worker, i, stop);
    }
    catch (...)
    {
    }
  });
}

/// Seconds since some time.
inline double seconds_since(std::chrono::steady_clock::time_point begun)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

/// As many of something as there are threads, one at least; made when they are first asked for.
template<typename T, typename Make>
void prepare_for(std::vector<std::unique_ptr<T>> & each, int threads, Make make)
{
  if (threads < 0)
    throw std::invalid_argument("threads");
  while (int(each.size()) < std::max(threads, 1))
    each.push_back(make(each.size()));
}
} // namespace condyn
