// The program of one adapter. A process of its own, because libraries from packages are compiled for the oldest
// processor of the architecture, where Eigen lays out memory differently, and because a library may end the process
// that it is in.
#pragma once

#include "peers.hpp"
#include "wire.hpp"

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <memory>
#include <utility>
#include <vector>

namespace peers {

/// Processor time of this thread [s]: what other programs on the machine do is not in it.
inline double thread_seconds()
{
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Seconds of `evaluations` of a path, round and round through the pool.
inline double run(const Path& path, std::size_t states, std::size_t evaluations)
{
  const double start = thread_seconds();
  for (std::size_t k = 0, state = 0; k < evaluations; ++k) {
    path.compute(state);
    if (++state == states) { state = 0; }
  }
  return thread_seconds() - start;
}

/// Answers the comparison until it hangs up; arguments: the descriptors to read from and to write to.
inline int serve(const Library& library, int argc, char** argv)
{
  if (argc != 3) {
    std::fprintf(stderr, "%s: started by iim_peers\n", argv[0]);
    return 2;
  }
  std::signal(SIGPIPE, SIG_IGN);
  Channel channel(std::atoi(argv[1]), std::atoi(argv[2]));
  std::unique_ptr<Peer> peer;
  std::vector<Path> paths;
  std::vector<State> states;
  try {
    channel.put(library.name);
    channel.put(library.version);
    for (;;) {
      switch (channel.get<Command>()) {
        case Command::model: {
          const Model model = channel.model();
          states.resize(channel.get<std::size_t>());
          for (State& x : states) {
            x.q = channel.matrix();
            x.qd = channel.matrix();
          }
          std::string failure;
          paths.clear();
          try {
            peer = library.make(model, states);
            if (peer) { paths = peer->paths(); }
          } catch (const std::exception& thrown) {
            failure = thrown.what();
          }
          channel.put(failure);
          channel.put(paths.size());
          for (const Path& path : paths) { channel.put(path.name); }
          break;
        }
        case Command::result: {
          const Path& path = paths.at(channel.get<std::size_t>());
          path.compute(channel.get<std::size_t>());
          const Result result = path.result();
          channel.put(MatrixXd(result.qdd0));
          channel.put(result.Bhat);
          break;
        }
        case Command::seconds: {
          const Path& path = paths.at(channel.get<std::size_t>());
          channel.put(run(path, states.size(), channel.get<std::size_t>()));
          break;
        }
      }
    }
  } catch (const Disconnected&) {
    return 0;
  } catch (const std::exception& thrown) {
    std::fprintf(stderr, "%s: %s\n", library.name.c_str(), thrown.what());
    return 1;
  }
}

}  // namespace peers
