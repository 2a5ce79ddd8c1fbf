// PART OF: iim_accuracy
// Tables of errors.
#include "report.hpp"
#include "../common/table.hpp"

#include <algorithm>
#include <cmath>

namespace bench {

namespace {

constexpr std::array<const char*, 3> scalars{"float", "double", "long double"};

double epsilon_of(const std::string& scalar)
{
  return scalar == "float" ? std::ldexp(1.0, -23) : scalar == "double" ? std::ldexp(1.0, -52) : std::ldexp(1.0, -63);
}

/// An error, or the status in its place, or both.
std::string cell(const Outcome& o, double value, std::size_t states)
{
  if (o.refused == static_cast<int>(states)) { return o.status; }
  std::string text = magnitude(value);
  if (o.refused > 0) {
    text += " (" + std::to_string(o.refused) + " of " + std::to_string(states) + " " + o.status + ")";
  }
  return text;
}

const std::vector<std::pair<std::string, std::string>> chosen{{"implicit inversion, printed", "printed"},
                                                              {"implicit inversion, projected", "projected"},
                                                              {"implicit inversion, square root", "square root"},
                                                              {"body-fixed frames, printed", "body-fixed, printed"},
                                                              {"body-fixed frames, projected", "body-fixed, projected"},
                                                              {"common origin, printed", "common origin, printed"},
                                                              {"branch-sparse Cholesky", "Cholesky"}};

const Outcome* find(const AccuracyResult& result, const std::string& variant, const std::string& scalar)
{
  for (const Outcome& o : result.outcomes) {
    if (o.scalar == scalar && (o.variant == variant || o.variant == "all")) { return &o; }
  }
  return nullptr;
}

/// Methods on the library's workspace by their update, both ways to factorise M as one.
std::string short_name(const std::string& variant)
{
  for (const char* method : {"implicit inversion, ", "unit forces, ", "recursive inverse, "}) {
    if (variant.rfind(method, 0) == 0) { return variant.substr(std::string(method).size()); }
  }
  return variant.find("Cholesky") != std::string::npos ? "Cholesky" : variant;
}

std::string in_epsilon(const Bound::Worst& w, int states)
{
  if (w.state < 0) { return "refused"; }
  std::string text = bench::text("%.3g", w.error) + " (" + bench::text("%.2g", w.sensitivity) + ")";
  if (w.refused > 0) { text += ", " + std::to_string(w.refused) + " of " + std::to_string(states) + " refused"; }
  return text;
}

/// Where the default stands among all variants in double.
std::string default_against_double(const std::vector<Outcome>& outcomes)
{
  const auto is_default = [](const Outcome& o) {
    return o.variant == "implicit inversion, projected" && o.scalar == "double";
  };
  const Outcome& own = *std::find_if(outcomes.begin(), outcomes.end(), is_default);
  const Outcome* fastest = &own;
  const Outcome* most_accurate = &own;
  for (const Outcome& o : outcomes) {
    if (o.scalar != "double" || o.refused > 0) { continue; }
    if (o.time < fastest->time) { fastest = &o; }
    if (o.Bhat_error < most_accurate->Bhat_error) { most_accurate = &o; }
  }
  return "implicit inversion, projected, double: " + three_digits(own.time / fastest->time) +
         " times as long as the fastest in double (" + fastest->variant + "), " +
         three_digits(own.Bhat_error / most_accurate->Bhat_error) + " times the error of the most accurate (" +
         most_accurate->variant + ", which takes " + three_digits(most_accurate->time / own.time) + " times as long)";
}

/// Results that a caller would take for right.
void write_silent(const std::vector<AccuracyResult>& results, Report& report)
{
  report.section("Wrong without a status");
  report.paragraph(
      "States that came back ok although B̂ or q̈₀ is off by more than 1 % where one ε of the scalar in the data moves "
      "it by less than 0.01 %, or although there is no result. All scenes of this report, every variant; behind each "
      "name how many of the states.");
  Table table({"scene", "scalar", "wrong without a status"});
  for (const AccuracyResult& result : results) {
    const std::string states = std::to_string(result.scene.states.size());
    for (const char* scalar : scalars) {
      std::string who;
      for (const Outcome& o : result.outcomes) {
        if (o.scalar != scalar || o.silent == 0) { continue; }
        who += (who.empty() ? "" : "; ") + o.variant + ": " + std::to_string(o.silent) + " of " + states;
      }
      if (!who.empty()) { table.add({result.scene.name, scalar, who}); }
    }
  }
  if (table.empty()) {
    report.paragraph("None.");
    return;
  }
  report.table(table.left());
  Table sums({"variant", "float", "double", "long double"});
  for (const Outcome& some : results.front().outcomes) {
    if (some.scalar != results.front().outcomes.front().scalar) { continue; }
    std::vector<std::string> row{some.variant};
    for (const char* scalar : scalars) {
      int silent = 0;
      int states = 0;
      for (const AccuracyResult& result : results) {
        const Outcome* o = find(result, some.variant, scalar);
        silent += o->silent;
        states += static_cast<int>(result.scene.states.size());
      }
      row.push_back(std::to_string(silent) + " of " + std::to_string(states));
    }
    sums.add(row);
  }
  report.table(sums);
}

}  // namespace

void write_bounds(const std::vector<Bound>& bounds, Report& report)
{
  report.section("Worst of many states, in ε of the scalar");
  report.paragraph(
      "In brackets: what one ε in the data moves at that state. The reference is the square-root form in long double.");
  for (const std::size_t scalar : {0u, 1u}) {
    const std::string name = scalar == 0 ? "double" : "float";
    Table table({"case, " + name, "states", "B̂ printed", "B̂ projected", "B̂ square root", "q̈₀ printed", "q̈₀ projected",
                 "q̈₀ square root"});
    for (const Bound& bound : bounds) {
      std::vector<std::string> row{bound.name, std::to_string(bound.states)};
      for (const auto& tier : bound.tiers[scalar]) { row.push_back(in_epsilon(tier.Bhat, bound.states)); }
      for (const auto& tier : bound.tiers[scalar]) { row.push_back(in_epsilon(tier.qdd0, bound.states)); }
      table.add(row);
    }
    report.table(table);
  }
}

void write_time_table(const AccuracyResult& result, Report& report)
{
  const std::size_t states = result.scene.states.size();
  report.paragraph("Condition number of M up to " + magnitude(result.reference.worst(&Yardstick::condition)) +
                   "; one ε of double in the data moves B̂ by up to " +
                   magnitude(result.reference.worst(&Yardstick::Bhat_sensitivity)) + " and q̈₀ by up to " +
                   magnitude(result.reference.worst(&Yardstick::qdd0_sensitivity)) + ".");
  const Outcome* printed = find(result, "implicit inversion, printed", "double");
  std::string front;
  for (const Outcome* o : accuracy_front(result.outcomes)) {
    front += (front.empty() ? "" : "; ") + o->variant + ", " + o->scalar + " (" + three_digits(o->time) + " µs, " +
             magnitude(o->Bhat_error) + ")";
  }
  report.paragraph("On the front, nothing being faster and more accurate at once: " + front +
                   ". The library's default is " + default_against_double(result.outcomes) + ".");
  Table table({"variant", "scalar", "time [µs]", "× printed, double", "error of B̂", "componentwise", "residual [ε]",
               "error of q̈₀"});
  for (const Outcome& o : result.outcomes) {
    table.add({o.variant, o.scalar, three_digits(o.time), three_digits(o.time / printed->time),
               cell(o, o.Bhat_error, states), cell(o, o.componentwise, states), cell(o, o.residual, states),
               cell(o, o.qdd0_error, states)});
  }
  report.table(table);
}

void write_overview(const std::vector<AccuracyResult>& results, const std::string& group, Report& report)
{
  for (const char* scalar : scalars) {
    for (const bool of_Bhat : {true, false}) {
      std::vector<std::string> head{std::string(of_Bhat ? "error of B̂, " : "error of q̈₀, ") + scalar, "cond(M)",
                                    "one ε in the data"};
      for (const auto& [variant, name] : chosen) { head.push_back(name); }
      Table table(head);
      for (const AccuracyResult& result : results) {
        if (result.scene.group != group) { continue; }
        const double epsilons = epsilon_of(scalar) / epsilon_of("double");
        const AccuracyReference& reference = result.reference;
        std::vector<std::string> row{result.scene.name};
        const bool exists = reference.failure.empty();
        row.push_back(exists ? magnitude(reference.worst(&Yardstick::condition)) : "–");
        row.push_back(exists ? magnitude(epsilons * reference.worst(of_Bhat ? &Yardstick::Bhat_sensitivity
                                                                            : &Yardstick::qdd0_sensitivity))
                             : reference.failure);
        for (const auto& [variant, name] : chosen) {
          const Outcome* o = find(result, variant, scalar);
          row.push_back(cell(*o, of_Bhat ? o->Bhat_error : o->qdd0_error, result.scene.states.size()));
        }
        table.add(row);
      }
      report.table(table);
    }
  }
}

void write_failures(const std::vector<AccuracyResult>& results, Report& report)
{
  report.paragraph(
      "Who fails, and how. «Wrong»: more than 100 times what one ε of the scalar in the data does at the same "
      "state, for B̂ or q̈₀; behind it the worst factor. The three methods that run on the library's workspace "
      "stand under their update. A status is no failure.");
  Table table({"scene", "scalar", "wrong", "answers by status"});
  std::string nobody;
  for (const AccuracyResult& result : results) {
    if (result.scene.group != "extreme" && result.scene.group != "mass ratio") { continue; }
    bool anybody = false;
    for (const char* scalar : {"double", "float"}) {
      std::vector<std::pair<std::string, double>> wrong;
      std::vector<std::pair<std::string, std::string>> refused;
      for (const Outcome& o : result.outcomes) {
        if (o.scalar != scalar) { continue; }
        const std::string who = short_name(o.variant);
        const double excess = std::max(o.Bhat_excess, o.qdd0_excess);
        const bool always = o.refused == static_cast<int>(result.scene.states.size());
        if (!always && !(excess <= 100)) {
          const auto at = std::find_if(wrong.begin(), wrong.end(), [&](const auto& w) { return w.first == who; });
          if (at == wrong.end()) {
            wrong.emplace_back(who, excess);
          } else {
            at->second = std::max(at->second, excess);
          }
        }
        const std::string status = o.status + (always ? "" : " at some states");
        if (o.refused > 0 && std::find(refused.begin(), refused.end(), std::pair(who, status)) == refused.end()) {
          refused.emplace_back(who, status);
        }
      }
      std::string who_is_wrong;
      for (const auto& [who, excess] : wrong) {
        who_is_wrong += (who_is_wrong.empty() ? "" : "; ") + who + " " + text("%.0e", excess);
      }
      std::string statuses;
      for (const auto& [who, status] : refused) { statuses += (statuses.empty() ? "" : "; ") + who + ": " + status; }
      anybody |= !wrong.empty() || !refused.empty();
      if (!wrong.empty() || !refused.empty()) {
        table.add({result.scene.name, scalar, wrong.empty() ? "–" : who_is_wrong, refused.empty() ? "–" : statuses});
      }
    }
    if (!anybody) { nobody += (nobody.empty() ? "" : "; ") + result.scene.name; }
  }
  report.table(table.left());
  report.paragraph("Nobody fails in double or float: " + nobody + ".");
  write_silent(results, report);
}

void write_details(const std::vector<AccuracyResult>& results, const std::string& group, Report& report)
{
  for (const AccuracyResult& result : results) {
    if (result.scene.group != group) { continue; }
    const std::size_t states = result.scene.states.size();
    const bool exists = result.reference.failure.empty();
    report.paragraph(result.scene.name + ": " + std::to_string(states) + " states, " +
                     (exists ? "condition number of M up to " + magnitude(result.reference.worst(&Yardstick::condition))
                             : "exactly: " + result.reference.failure) +
                     ".");
    Table table(
        {"variant", "scalar", "error of B̂", "× data", "componentwise", "residual [ε]", "error of q̈₀", "× data"});
    for (const Outcome& o : result.outcomes) {
      table.add({o.variant, o.scalar, cell(o, o.Bhat_error, states), magnitude(o.Bhat_excess),
                 magnitude(o.componentwise), magnitude(o.residual), magnitude(o.qdd0_error), magnitude(o.qdd0_excess)});
    }
    report.table(table);
  }
}

}  // namespace bench
