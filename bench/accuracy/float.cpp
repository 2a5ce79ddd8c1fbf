// PART OF: iim_accuracy
#include "variants.hpp"

namespace bench {

template <>
std::vector<Outcome> accuracy_outcomes<float>(const AccuracyScene& scene, const AccuracyReference& reference)
{
  return outcomes_in<float>("float", scene, reference);
}

template <>
std::vector<Pass> accuracy_passes<float>(const AccuracyScene& scene)
{
  return passes_in<float>("float", scene);
}

}  // namespace bench
