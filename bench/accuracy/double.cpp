// PART OF: iim_accuracy
#include "variants.hpp"

namespace bench {

template <>
std::vector<Outcome> accuracy_outcomes<double>(const AccuracyScene& scene, const AccuracyReference& reference)
{
  return outcomes_in<double>("double", scene, reference);
}

template <>
std::vector<Pass> accuracy_passes<double>(const AccuracyScene& scene)
{
  return passes_in<double>("double", scene);
}

}  // namespace bench
