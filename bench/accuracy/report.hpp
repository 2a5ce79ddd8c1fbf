// What stands in accuracy.md.
#pragma once

#include "../common/figure.hpp"
#include "../common/report.hpp"
#include "accuracy.hpp"

#include <string>
#include <vector>

namespace bench {

struct AccuracyResult {
  AccuracyScene scene;
  AccuracyReference reference;
  std::vector<Outcome> outcomes;
};

/// The median time of every outcome: all variants take turns.
void measure_times(AccuracyResult& result);

/// Ratios of the tiers' times on the biped.
void write_costs(bool quick, Report& report);

/// The bounds that are aimed at, against the worst of many states.
void write_bounds(const std::vector<Bound>& bounds, Report& report);

/// Time and errors of every variant on one scene.
void write_time_table(const AccuracyResult& result, Report& report);

/// A row per scene of the group: condition, sensitivity and the errors of the chosen variants.
void write_overview(const std::vector<AccuracyResult>& results, const std::string& group, Report& report);

/// Per extreme scene who fails, and how; and how many results of whom are wrong without a status.
void write_failures(const std::vector<AccuracyResult>& results, Report& report);

/// All measures of all variants on the scenes of the group.
void write_details(const std::vector<AccuracyResult>& results, const std::string& group, Report& report);

/// Error of B̂ over the scene's parameter, one curve per variant of the scalar.
Figure error_over(const std::vector<AccuracyResult>& results, const std::string& group, const std::string& title,
                  const std::string& x, const std::string& scalar);

/// Those that no other beats in time and error of B̂ at once, fastest first.
std::vector<const Outcome*> accuracy_front(const std::vector<Outcome>& outcomes);

/// Error against run time, a point per variant and scalar, with the front. Writes NAME.gp and, with gnuplot, NAME.svg.
/// Returns NAME; `drawn` becomes false if there is no gnuplot.
std::string draw_error_against_time(const AccuracyResult& result, const std::string& folder, bool& drawn);

/// Writes NAME.gp of every figure, its logarithmic axes in powers of ten, and NAME.svg. False if there is no gnuplot.
bool draw_in_powers(const std::vector<Figure>& figures, const std::string& folder);

/// Condition numbers of mass matrices after Featherstone, and accuracy by elimination after Ascher, Pai, Cloutier.
std::vector<Figure> known_experiments(bool quick, Report& report);

/// Drift of energy and momentum over many steps.
std::vector<Figure> long_runs(bool quick, Report& report);

/// Stiff machines over seconds: implicit steps, explicit ones that blow up, and how far both are from small steps.
std::vector<Figure> stiff_scenes(bool quick, Report& report);

}  // namespace bench
