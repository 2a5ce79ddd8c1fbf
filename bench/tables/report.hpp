// What the records say: tables with the paper's statements beside them, figures, files.
#pragma once

#include "cost.hpp"
#include "study.hpp"

#include <filesystem>
#include <iosfwd>
#include <vector>

namespace bench {

/// Circumstances of a run, for the head of the report.
struct Circumstances {
  int core;     ///< that the process was pinned to; −1: none
  double load;  ///< at the start
  double seconds;
};

/// Writes report.md, tables.csv and the figures into the folder; the tables also to the terminal.
void write_report(const Records& records, const std::vector<Method>& methods, const Effort& effort,
                  const CostOfGrowth& cost, const Circumstances& circumstances, const std::filesystem::path& folder,
                  std::ostream& terminal);

}  // namespace bench
