// Time and size of a controller: peers/controller.cpp compiled once more, by the command that the build used for it.
#pragma once

#include "../common/statistics.hpp"

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <sys/resource.h>

namespace peers {

/// What a controller costs before it runs.
struct CompileCost {
  bench::Spread seconds;  ///< processor time of one compilation without linking
  std::uintmax_t bytes;   ///< of the program
};

namespace detail {

/// The string behind `"key": ` on a line of JSON as CMake writes it; empty if the line has another key.
inline std::string json_string(const std::string& line, const std::string& key)
{
  const std::string head = '"' + key + "\": \"";
  const std::size_t begin = line.find(head);
  std::string text;
  if (begin == std::string::npos) { return text; }
  for (std::size_t k = begin + head.size(); k < line.size() && line[k] != '"'; ++k) {
    if (line[k] == '\\') { ++k; }
    text += line[k];
  }
  return text;
}

/// Processor time of all children that have ended [s].
inline double children_seconds()
{
  rusage usage{};
  getrusage(RUSAGE_CHILDREN, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace detail

/// The build's own command, `repetitions` times. Throws std::runtime_error if command, compiler or program is missing.
/// `programs`: folder of the programs, below that of the build; `scratch`: where the object file may stand.
inline CompileCost compile_controller(const std::filesystem::path& programs, const std::filesystem::path& scratch,
                                      int repetitions)
{
  std::ifstream commands(programs.parent_path() / "compile_commands.json");
  std::string directory, command;
  bool found = false;
  for (std::string line; !found && std::getline(commands, line);) {
    if (const auto text = detail::json_string(line, "directory"); !text.empty()) { directory = text; }
    if (const auto text = detail::json_string(line, "command"); !text.empty()) { command = text; }
    found = detail::json_string(line, "file").ends_with("peers/controller.cpp");
  }
  if (!found) { throw std::runtime_error("the build left no compile_commands.json"); }
  const std::filesystem::path object = std::filesystem::absolute(scratch) / "controller.o";
  const std::string again =
      "cd '" + directory + "' && CCACHE_DISABLE=1 " + command + " -o '" + object.string() + "' 2> /dev/null";
  std::vector<double> seconds;
  for (int k = 0; k < repetitions; ++k) {
    const double start = detail::children_seconds();
    if (std::system(again.c_str()) != 0) { throw std::runtime_error("the compiler of the build cannot be called"); }
    seconds.push_back(detail::children_seconds() - start);
  }
  std::filesystem::remove(object);
  return {bench::spread(seconds), std::filesystem::file_size(programs / "iim_peers_controller")};
}

}  // namespace peers
