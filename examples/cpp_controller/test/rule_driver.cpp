// Applies the rule to lines on standard input and prints one line per decision; for the tests.
//
//   new FRAME FOLLOWS                                a new rule
//   rearm
//   stand NOW
//   receive NOW ID SETUP SEQ FRAME STAMP UNTIL STATE HOLD SIMULATED CURRENT FREE_DISTANCE FREE_TURN
//           TOOL_SPEED TOOL_TURN COUNT [normal offset point velocity]*COUNT, on one line
//   allow NOW TWIST(6) TIP(3)                        prints: PERMISSION REASON LATCHED TWIST(6)
//
// Times are in ns, lengths in m. "-" is an empty id. Numbers may be nan or inf.
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <string>

#include "marginguard/fixture_rule.hpp"

namespace {

double number(std::istream& in) {
  std::string text;
  in >> text;
  return std::strtod(text.c_str(), nullptr);  // operator>> does not read nan and inf
}

template <std::size_t N>
std::array<double, N> numbers(std::istream& in) {
  std::array<double, N> values{};
  for (double& value : values) value = number(in);
  return values;
}

void receive(marginguard::FixtureRule& rule, std::istream& in) {
  std::int64_t now_ns = 0;
  std::string id, setup, frame;
  int hold = 0, simulated = 0, current = 0;
  marginguard::PlainConstraint message;
  in >> now_ns >> id >> setup >> message.seq >> frame >> message.stamp_ns >>
      message.valid_until_ns >> message.state >> hold >> simulated >> current;
  message.free_distance = number(in);
  message.free_turn = number(in);
  message.max_tool_speed = number(in);
  message.max_tool_turn = number(in);
  in >> message.count;
  message.instance_id = id == "-" ? std::string_view{} : std::string_view{id};
  message.setup_id = setup == "-" ? std::string_view{} : std::string_view{setup};
  message.frame = frame;
  message.hold = hold != 0;
  message.simulated = simulated != 0;
  message.planes_current = current != 0;
  for (std::size_t k = 0; k < std::min(message.count, marginguard::kMaxPlanes); ++k) {
    marginguard::HalfSpace& plane = message.planes[k];
    plane.normal = numbers<3>(in);
    plane.offset = number(in);
    plane.point_on_tool = numbers<3>(in);
    plane.tumor_velocity = numbers<3>(in);
  }
  rule.receive(message, now_ns);
}

void allow(marginguard::FixtureRule& rule, std::istream& in) {
  std::int64_t now_ns = 0;
  in >> now_ns;
  const marginguard::Vector6 desired = numbers<6>(in);
  const marginguard::Vector3 tip = numbers<3>(in);
  const marginguard::Decision decision = rule.allow(desired, tip, now_ns);
  std::printf("%s %s %d", name_of(decision.permission), name_of(decision.reason), rule.latched());
  for (const double value : decision.twist) std::printf(" %.17g", value);
  std::printf("\n");
}

}  // namespace

int main() {
  marginguard::FixtureRule rule;
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream in(line);
    std::string command;
    in >> command;
    if (command == "new") {
      std::string frame;
      marginguard::RuleParameters parameters;
      in >> frame >> parameters.follows_setup;
      rule = marginguard::FixtureRule(frame, parameters);
    } else if (command == "rearm") {
      rule.rearm();
    } else if (command == "stand") {
      std::int64_t now_ns = 0;
      in >> now_ns;
      rule.stand(now_ns);
    } else if (command == "receive") {
      receive(rule, in);
    } else if (command == "allow") {
      allow(rule, in);
    } else {
      std::fprintf(stderr, "unknown command: %s\n", command.c_str());
      return 1;
    }
  }
  return 0;
}
