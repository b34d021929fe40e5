// The core that the playground's page holds: a scene as bytes in, the page's commands in, its samples out.
#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/built_for.h"
#include "common/hardware/transparency_host.h"
#include "common/page/judge.h"
#include "web/playground/make_run.h"
#include "web/playground/packed_scene.h"

namespace twoport {

// A page starts no process; a scene with a layer PLUGIN is not packed.
std::shared_ptr<TransparencyHost> start_transparency_process(const std::string&, const std::string&, int, Seconds,
                                                             bool) {
  return nullptr;
}

namespace {
std::string input;
std::unique_ptr<playground::Run> run;
std::optional<PageJudge> page_judge;
PageVerdict judged;
std::vector<double> numbers;
PageCommand before;
}  // namespace
}  // namespace twoport

using namespace twoport;

#ifdef __wasm__
#define TWOPORT_EXPORT(name) extern "C" __attribute__((export_name(#name), visibility("default")))
#else
#define TWOPORT_EXPORT(name) extern "C"
#endif

/// Where the caller writes `size` bytes, for start() and command().
TWOPORT_EXPORT(input) char* input_of(int size) {
  input.resize(static_cast<std::size_t>(size));
  return input.data();
}
/// Begins the scene in the input; scripted: with the scene's own hand.
TWOPORT_EXPORT(start) void start(int scripted) {
  Scene scene{};
  playground::Unpacker{input.data()}(scene);
  run.reset();
  page_judge.emplace(scene, std::min(PageSamples::kSampleHz, scene.master_rate_hz), true);
  run = for_cartesian_dof(scene.dof, "the playground",
                          [&]<int N>() { return playground::make_run<N>(scene, scripted != 0); });
}
/// A command of the page in the input. 0: it is malformed.
TWOPORT_EXPORT(command) int command() {
  const std::optional<PageCommand> c = parse_page_command(input);
  if (!c) return 0;
  // A pointer that stays where it is says so again and again.
  if (c->kind != PageCommand::Kind::target || c->kind != before.kind || c->number != before.number)
    page_judge->disturb();
  before = *c;
  PageChannel& to = *run->page().channel();
  (c->is_of_hand() ? to.hand : to.commands).try_push(*c);
  return 1;
}
/// Goes on to a time since the start, and returns how many numbers of samples there are at samples().
TWOPORT_EXPORT(until) int until(double end_s) {
  run->until(to_duration(end_s));
  numbers.clear();
  PageSample sample;
  while (run->page().channel()->samples.try_pop(sample)) {
    page_judge->add(sample);
    for_each_page_field(sample, [](const char*, std::size_t size, const double* field) {
      numbers.insert(numbers.end(), field, field + size);
    });
  }
  return static_cast<int>(numbers.size());
}
TWOPORT_EXPORT(samples) const double* samples() {
  return numbers.data();
}

/// Judges the run so far: the verdict, then its reason and the budget, as the page is told them by the master.
TWOPORT_EXPORT(verdict) const char* verdict() {
  judged = page_judge->verdict();
  return to_string(judged.kind).data();
}
TWOPORT_EXPORT(reason) const char* reason() {
  return judged.reason.c_str();
}
TWOPORT_EXPORT(initial_energy_j) double initial_energy_j() {
  return page_judge->initial_energy_j();
}
TWOPORT_EXPORT(earlier_debt_j) double earlier_debt_j() {
  return page_judge->earlier_debt_j();
}
TWOPORT_EXPORT(both_initial_energy_j) double both_initial_energy_j() {
  return page_judge->both_initial_energy_j();
}
TWOPORT_EXPORT(both_earlier_debt_j) double both_earlier_debt_j() {
  return page_judge->both_earlier_debt_j();
}
