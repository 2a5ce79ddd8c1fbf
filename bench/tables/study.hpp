// The scenes of the paper's study, and what is measured on them.
#pragma once

#include "../common/methods.hpp"
#include "../common/statistics.hpp"

#include <iosfwd>
#include <string>
#include <vector>

namespace bench {

struct Options {
  bool quick = false;
  std::string out;  ///< report folder
};

/// How much is measured.
struct Effort {
  int repetitions;             ///< per method and scene
  double min_time;             ///< of one repetition [s]
  int states;                  ///< in the pool
  int reference_states;        ///< of these that are compared with the reference
  std::vector<Index> chain_n;  ///< Fig. 3
  std::vector<Index> inputs;   ///< Fig. 4, Table 2
};

inline constexpr Index longest = 50;    ///< links of Fig. 4 and Table 1
inline constexpr Index full_tree = 63;  ///< the complete binary tree with all its levels full

/// One method on one scene.
struct Record {
  SceneId scene;
  std::string method;  ///< Method::id
  Spread time;         ///< [µs], processor time of one evaluation
  double ratio;        ///< of the median to that of implicit inversion, same scene, same minute
  double error_qdd0;   ///< relative, the worst of the states compared
  double error_Bhat;
};

/// All records; rows are found by scene and method.
struct Records {
  std::vector<Record> all;

  const Record* find(const SceneId& scene, const std::string& method) const
  {
    for (const Record& record : all) {
      if (record.scene == scene && record.method == method) { return &record; }
    }
    return nullptr;
  }
};

Effort effort(bool quick);

/// The scenes, in the order of the paper.
std::vector<SceneId> scenes(const Effort& effort);

/// Measures every method on every scene: within a scene the repetitions of all methods are mixed, in one process on one
/// core. Says on `progress` what it does; writes Google Benchmark's JSON to `json`.
Records measure(const std::vector<Method>& methods, const Effort& effort, std::ostream& progress, std::ostream& json);

}  // namespace bench
