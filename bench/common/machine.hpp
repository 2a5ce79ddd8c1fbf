// Where a measurement was taken: processor, core, load, date.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>
#include <thread>

#if defined(__linux__)
#include <sched.h>
#endif

namespace bench {

/// Keeps the calling thread on one core, the last that it may use (the first ones take most interrupts).
/// Returns that core; −1 if the system does not allow it, and then nothing has changed.
inline int pin_to_one_core()
{
#if defined(__linux__)
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) { return -1; }
  for (int core = CPU_SETSIZE - 1; core >= 0; --core) {
    if (CPU_ISSET(static_cast<unsigned>(core), &allowed)) {
      cpu_set_t one;
      CPU_ZERO(&one);
      CPU_SET(static_cast<unsigned>(core), &one);
      return sched_setaffinity(0, sizeof one, &one) == 0 ? core : -1;
    }
  }
#endif
  return -1;
}

/// Name of the processor as the system gives it.
inline std::string processor()
{
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (line.starts_with("model name") || line.starts_with("Model")) {
      const std::size_t colon = line.find(':');
      if (colon != std::string::npos && colon + 2 < line.size()) { return line.substr(colon + 2); }
    }
  }
  return "unknown processor";
}

/// Number of cores that the system offers.
inline unsigned cores() { return std::max(1u, std::thread::hardware_concurrency()); }

/// Load of the last minute [runnable tasks]; −1 if unknown.
inline double load_average()
{
#if defined(__unix__) || defined(__APPLE__)
  double load = 0;
  if (getloadavg(&load, 1) == 1) { return load; }
#endif
  return -1;
}

/// Now, in UTC, ISO 8601.
inline std::string date()
{
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", std::gmtime(&now));
  return text;
}

}  // namespace bench
