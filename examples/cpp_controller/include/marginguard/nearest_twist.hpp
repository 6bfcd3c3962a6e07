// The twist nearest to a desired one within at most 8 half-spaces: an exact quadratic program.
//
// C++17 standard library only; no dynamic memory, no exceptions, bounded run time. SI units.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace marginguard {

using Vector3 = std::array<double, 3>;
using Vector6 = std::array<double, 6>;

constexpr std::size_t kMaxPlanes = 8;
constexpr double kTurnRad = 0.1;      // largest turn of the tool for which the planes are made
constexpr double kCoverM = 0.002;     // the planes leave room for the turn times this
constexpr double kLeastShare = 1e-9;  // of the free motion: what is left where it is used up
constexpr double kLeastFreeM = 1e-4;  // a free motion of less is taken as this
constexpr double kLeastFreeRad = 1e-3;

// A half-space of the constraint, as marginguard_msgs/HalfSpace.
struct HalfSpace {
  Vector3 normal{};
  double offset = 0.0;
  Vector3 point_on_tool{};
  Vector3 tumor_velocity{};
};

struct LimiterParameters {
  double tau_s = 0.05;        // time constant of the approach: clearance / speed
  double lever_m = 0.05;      // weight of rotation in the cost, m/s per rad/s
  double retreat_m_s = 0.02;  // maximum speed at which the tool is driven back
  double max_m_s = 0.25;
  double max_rad_s = 2.0;
};

// How far the tool may move before something counts that its planes do not describe: the way of its
// tip and its turn. Both at once share: way / distance + angle / turn < 1.
struct FreeMotion {
  double distance = 0.0;
  double turn = 0.0;
};

// Upper bounds of the tool's motion since a time.
struct Moved {
  std::array<double, kMaxPlanes> approach{};  // of the planes' points, relative to the tumour
  double way = 0.0;                           // path of the tip
  double turn = 0.0;                          // path of the rotation
};

// The planes are those of an earlier time; the tool has `moved` since.
struct Delay {
  Moved moved{};
  FreeMotion free{};
  double max_approach_m_s = 0.0;  // the approach that the guard's margin assumes
  double validity_s = 0.0;        // a plane is approached faster only where it is farther than this
};

template <std::size_t N>
bool all_finite(const std::array<double, N>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

namespace detail {

// Of the sizes of the terms. The second one is for planes that are almost parallel.
constexpr std::array<double, 2> kRelativeTolerances{1e-12, 1e-9};
constexpr double kDependent = 1e-9;  // share of a row that must be independent of the others

template <std::size_t N>
double dot(const std::array<double, N>& a, const std::array<double, N>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < N; ++i) sum += a[i] * b[i];
  return sum;
}

inline double norm(const Vector6& x) { return std::sqrt(dot(x, x)); }

// Rows a_i and bounds b_i of the inequalities a_i . x >= b_i.
struct Inequalities {
  std::array<Vector6, kMaxPlanes> rows{};
  std::array<double, kMaxPlanes> lower{};
  std::size_t count = 0;

  // True if `x`, which was computed from `desired`, keeps all of them; false if it is not finite.
  bool hold_for(const Vector6& x, const Vector6& desired, double tolerance) const {
    const double speed = norm(x) + norm(desired);
    for (std::size_t i = 0; i < count; ++i) {
      const double size = std::abs(lower[i]) + norm(rows[i]) * speed;
      const double value = dot(rows[i], x);
      if (!(value >= lower[i] - tolerance * size) || !std::isfinite(size)) return false;
    }
    return true;
  }
};

// Projection of a point on the intersection of half-spaces, by enumeration.
//
// The projection lies on the planes of some linearly independent set of rows and is the point of
// these planes nearest to the given one. So the nearest feasible one of the points of all such sets
// is the projection; no sign of a multiplier has to be decided. Each set extends a smaller one by a
// step along the direction that keeps the planes of the smaller one (Gram-Schmidt). 8 rows have 246
// sets of at most 6.
class Projection {
 public:
  explicit Projection(const Inequalities& inequalities) : inequalities_(inequalities) {}

  // False if there is no feasible point.
  bool of(const Vector6& point, Vector6& nearest) {
    start_ = point;
    found_ = false;
    for (const double tolerance : kRelativeTolerances) {
      tolerance_ = tolerance;
      best_ = std::numeric_limits<double>::infinity();
      visit(point, 0, 0);
      if (found_) break;
    }
    nearest = nearest_;
    return found_;
  }

 private:
  void visit(const Vector6& x, std::size_t first, std::size_t depth) {
    double distance = 0.0;
    for (std::size_t k = 0; k < 6; ++k) distance += (x[k] - start_[k]) * (x[k] - start_[k]);
    if (!(distance < best_)) return;  // a larger set is not nearer
    if (inequalities_.hold_for(x, start_, tolerance_)) {
      best_ = distance;
      nearest_ = x;
      found_ = true;
      return;
    }
    if (depth == 6) return;
    for (std::size_t i = first; i < inequalities_.count; ++i) {
      const Vector6& row = inequalities_.rows[i];
      Vector6 direction = row;
      for (int pass = 0; pass < 2; ++pass) {  // the second pass removes rounding errors
        for (std::size_t j = 0; j < depth; ++j) {
          const double along = dot(direction, basis_[j]);
          for (std::size_t k = 0; k < 6; ++k) direction[k] -= along * basis_[j][k];
        }
      }
      const double length = norm(direction);
      if (!(length > kDependent * norm(row))) continue;
      for (double& value : direction) value /= length;
      const double step = (inequalities_.lower[i] - dot(row, x)) / dot(row, direction);
      Vector6 moved = x;
      for (std::size_t k = 0; k < 6; ++k) moved[k] += step * direction[k];
      basis_[depth] = direction;
      visit(moved, i + 1, depth + 1);
    }
  }

  const Inequalities& inequalities_;
  Vector6 start_{};
  Vector6 nearest_{};
  std::array<Vector6, 6> basis_{};
  double tolerance_ = 0.0;
  double best_ = 0.0;
  bool found_ = false;
};

// `twist` scaled down so that its speed and angular speed are within their limits.
inline Vector6 limited_speed(Vector6 twist, const LimiterParameters& parameters) {
  const double speed = std::hypot(twist[0], twist[1], twist[2]) / parameters.max_m_s;
  const double turning = std::hypot(twist[3], twist[4], twist[5]) / parameters.max_rad_s;
  const double excess = std::max(speed, turning);
  if (excess > 1.0) {
    for (double& value : twist) value /= excess;
  }
  return twist;
}

// Shares of a speed in m/s and in rad/s, which together may be 1 at most.
struct Shares {
  double per_m_s = 0.0;
  double per_rad_s = 0.0;

  // `twist` scaled down to its share of speed.
  Vector6 limited_speed(Vector6 twist) const {
    const double share = std::hypot(twist[0], twist[1], twist[2]) * per_m_s +
                         std::hypot(twist[3], twist[4], twist[5]) * per_rad_s;
    if (!(share <= 1.0)) {
      for (double& value : twist) value /= share;
    }
    return twist;
  }
};

// The shares with which the free motion is never used up: it is approached as a plane is, at most
// at what is left / tau. Where there is less than kLeastFreeM, the tool may be moved by that, or it
// could not leave the place.
inline Shares shares_of(const FreeMotion& free, const Moved& moved,
                        const LimiterParameters& parameters) {
  const double distance = std::max(free.distance, kLeastFreeM);
  const double turn = std::max(std::min(free.turn, kTurnRad), kLeastFreeRad);
  const double left = std::max(1.0 - moved.way / distance - moved.turn / turn, kLeastShare);
  return {parameters.tau_s / (left * distance), parameters.tau_s / (left * turn)};
}

// False if there is no twist within `inequalities`, or if it is too fast and leaves them when
// scaled.
inline bool nearest_feasible(const Vector6& desired, const Inequalities& inequalities,
                             const Shares& shares, const LimiterParameters& parameters,
                             Vector6& allowed) {
  allowed = desired;
  if (!inequalities.hold_for(desired, desired, kRelativeTolerances.front())) {
    // Scale the rotation by the lever, so that the cost is the Euclidean distance.
    Inequalities scaled = inequalities;
    Vector6 point = desired;
    for (std::size_t k = 3; k < 6; ++k) {
      point[k] *= parameters.lever_m;
      for (Vector6& row : scaled.rows) row[k] /= parameters.lever_m;
    }
    Projection projection(scaled);
    if (!projection.of(point, allowed)) return false;
    for (std::size_t k = 3; k < 6; ++k) allowed[k] /= parameters.lever_m;
  }
  allowed = shares.limited_speed(limited_speed(allowed, parameters));
  return all_finite(allowed) && inequalities.hold_for(allowed, desired, kRelativeTolerances.back());
}

}  // namespace detail

// The twist nearest to `desired` that keeps the first `count` planes; zero if there is none.
//
// A twist is the velocity of the tool's origin, then the angular velocity, along the axes of the
// planes. For each plane with normal n, tool point p and clearance c:
// n . (v + w x (p - origin) - v_tumor) >= min(-c / tau, retreat). With `hold` the right side is 0.
// Where the tool cannot be driven back from all planes, it is not driven back. Without `delay` the
// planes are those of now; with it the motion since is subtracted from c and from the free motion,
// and the right side is not below -max(max_approach, c / validity). A twist that is too fast is
// scaled down, which keeps its direction. No plane is violated by more than 1e-9 of
// |bound| + |row| (|twist| + |desired|). Twist, origin and planes must be finite, `count` at most 8.
inline Vector6 limit_twist(const Vector6& desired, const std::array<HalfSpace, kMaxPlanes>& planes,
                           std::size_t count, bool hold, const Vector3& origin,
                           const LimiterParameters& parameters, const Delay* delay = nullptr) {
  detail::Inequalities driven, still;
  driven.count = still.count = std::min(count, kMaxPlanes);
  detail::Shares shares;
  if (delay != nullptr) shares = detail::shares_of(delay->free, delay->moved, parameters);
  for (std::size_t i = 0; i < driven.count; ++i) {
    const HalfSpace& plane = planes[i];
    const Vector3& n = plane.normal;
    Vector3 r{};
    for (std::size_t k = 0; k < 3; ++k) r[k] = plane.point_on_tool[k] - origin[k];
    driven.rows[i] = {n[0],
                      n[1],
                      n[2],
                      r[1] * n[2] - r[2] * n[1],
                      r[2] * n[0] - r[0] * n[2],
                      r[0] * n[1] - r[1] * n[0]};
    double clearance = detail::dot(n, plane.point_on_tool) - plane.offset;
    if (delay != nullptr) clearance -= delay->moved.approach[i] + kCoverM * delay->moved.turn;
    double approach = std::min(-clearance / parameters.tau_s, parameters.retreat_m_s);
    if (delay != nullptr) {
      const double far_m_s = clearance / delay->validity_s;
      approach = std::max(approach, -std::max(delay->max_approach_m_s, far_m_s));
    }
    if (hold) approach = 0.0;
    const double tumor = detail::dot(n, plane.tumor_velocity);
    driven.lower[i] = approach + tumor;
    still.lower[i] = std::min(approach, 0.0) + tumor;
  }
  still.rows = driven.rows;
  const Vector6 slow = detail::limited_speed(desired, parameters);
  Vector6 allowed{};
  for (const detail::Inequalities& bounds : {driven, still}) {
    if (detail::nearest_feasible(slow, bounds, shares, parameters, allowed)) return allowed;
    if (delay == nullptr) continue;
    // The hand's motion and driving the tool back are too fast together: it is driven back.
    if (detail::nearest_feasible({}, bounds, shares, parameters, allowed)) return allowed;
  }
  return Vector6{};
}

}  // namespace marginguard
