#pragma once

#include "lab/lanes/vector.h"

// INTERNAL_MODEL over lanes: a copy of common/method/internal_model, common/method/surface and common/passivity/energy_spring.h for
// N = 1, 3 without `strict_two_port`, in their order. Included as loop.h.

/// low_pass() where m.
static inline void low_pass(M m, V& y, V x, V weight) {
  set(m, y, y + weight * (x - y));
}
template <int N>
static inline void low_pass(M m, Vec<N>& y, Vec<N> x, V weight) {
  set(m, y, y + weight * (x - y));
}
template <int N>
struct Depth {
  V depth;
  Vec<N> normal;
};
/// SurfacePatch::at.
template <int N>
static inline Depth<N> depth_at(const Patch<V, N>& patch, Vec<N> y) {
  const Vec<N> n = patch.normal, from = y - patch.point;
  Depth<N> out{dot(n, from), n};
  if constexpr (N > 1) {
    const V bend = absolute(patch.curvature);
    const M curved = ~(bend < 0.1);
    if (any(curved)) {
      const V radius = 1.0 / bend, sign = select(patch.curvature < 0.0, all(-1.0), all(1.0));
      const Vec<N> from_center = from + n / patch.curvature;
      const V distance = norm(from_center);
      const M round = curved & (distance > 0.05 * radius);
      set(round, out.depth, sign * (distance - radius));
      out.normal = select(round, (sign / distance) * from_center, out.normal);
    }
  }
  return out;
}

// The slave.

/// SurfaceEstimator::turn.
template <int N>
static inline void turn(M m, Patch<V, N>& found, Vec<N> to, V weight) {
  low_pass(m, found.normal, to, weight);
  const Vec<N> n = found.normal;
  const V size = norm(n);
  set(m, found.normal, select(size > 1e-3, n / size, to));
}
/// SurfaceEstimator::step.
template <int N>
static inline void estimate(const Parameters<V, N>& p, InternalModel<V, N>& m, Vec<N> x, Vec<N> v, Vec<N> f) {
  constexpr double kPriorXx = 30e-6 * 30e-6, kPriorVv = 3e-3 * 3e-3;
  const M every = ~M{};
  Patch<V, N>& found = m.found;
  low_pass(every, m.f_contact, f, p.weight_3ms);
  const V size = norm(m.f_contact);
  const M was = m.contact != 0.0, begins = ~was & (size > 0.3);
  set(was, m.quiet_s, select(size < 0.1, m.quiet_s + p.dt, V{}));
  const M ends = was & (m.quiet_s >= 3e-3), in = was & ~ends;
  m.contact = one_if(in | begins);
  if (any(begins)) [[unlikely]] {
    set(begins, m.quiet_s, V{}), set(begins, m.age_s, V{});
    set(begins, m.x_slow, x), set(begins, m.x_mean, x);
    set(begins, m.v_slow, v), set(begins, m.v_surface, v);
    set(begins, m.f_slow, f), set(begins, m.f_surface, f);
    set(begins, m.xx, V{}), set(begins, m.xv, V{}), set(begins, m.vv, V{}), set(begins, m.xf, V{});
    set(begins, m.vf, V{}), set(begins, m.damping, V{}), set(begins, m.variance, V{}), set(begins, m.covariance, V{});
    set(begins, found.friction, V{}), set(begins, found.curvature, V{});
    const Vec<N> n = m.f_contact / size;
    set(begins, found.normal, n), set(begins, m.n_mean, n);
    set(begins, found.stiffness, all(2000.0));
    set(begins, found.point, x - (positive(dot(f, n)) / all(2000.0)) * n);
  }
  if (!any(in)) return;
  set(in, m.age_s, m.age_s + p.dt);
  // filter
  low_pass(in, m.x_slow, x, p.weight_20ms);
  low_pass(in, m.v_slow, v, p.weight_20ms);
  low_pass(in, m.f_slow, f, p.weight_20ms);
  const Vec<N> sliding = m.v_slow - (f - m.f_slow) / (20e-3 * found.stiffness);
  low_pass(in, m.v_surface, sliding, p.weight_10ms);
  low_pass(in, m.f_surface, m.f_slow, p.weight_10ms);
  // fit_stiffness
  const Vec<N> moved = x - m.x_slow, n = found.normal;
  const V travel = dot(moved, n), force = dot(f - m.f_slow, n), speed = dot(v - m.v_slow, n);
  const M pressed = ~(absolute(travel) < 0.8 * norm(moved)),
          still = (absolute(force) < 0.05) & (absolute(travel) < 0.5e-3);
  const M fits = in & pressed & ~still;
  if (any(fits)) {
    low_pass(fits, m.xx, travel * travel, p.weight_500ms);
    low_pass(fits, m.xv, travel * speed, p.weight_500ms);
    low_pass(fits, m.vv, speed * speed, p.weight_500ms);
    low_pass(fits, m.xf, travel * force, p.weight_500ms);
    low_pass(fits, m.vf, speed * force, p.weight_500ms);
    const V a = m.xx + kPriorXx, c = m.vv + kPriorVv, q = m.xf + 2000.0 * kPriorXx;
    const V determinant = a * c - m.xv * m.xv;
    set(fits, found.stiffness, clamp((q * c - m.vf * m.xv) / determinant, all(100.0), all(50000.0)));
    set(fits, m.damping, positive((a * m.vf - m.xv * q) / determinant));
  }
  if constexpr (N > 1) {
    // fit_normal
    const Vec<N> v_surface = m.v_surface, f_surface = m.f_surface;
    const V v_size = norm(v_surface), f_size = norm(f_surface);
    M slides = in & (v_size > 8e-3);
    if (any(slides)) {
      const Vec<N> u = v_surface / v_size;
      const V along = dot(f_surface, u);
      slides &= absolute(along) < 0.75 * f_size;
      const Vec<N> across = f_surface - along * u;
      const V across_size = norm(across);
      turn(slides, found, across / across_size, p.weight_30ms);
      low_pass(slides, found.friction, clamp(along / across_size, V{}, all(1.0)), p.weight_50ms);
    }
    const M rests =
        in & ~slides & (m.age_s < 0.3) & (found.friction < 0.05) & (dot(f_surface, found.normal) > 0.970 * f_size);
    if (any(rests)) turn(rests, found, f_surface / f_size, p.weight_100ms);
    // fit_curvature
    const Vec<N> normal = found.normal;
    const V way = norm(v_surface - dot(v_surface, normal) * normal) * p.dt;
    const V a = least(all(1.0), way / 15e-3);
    Vec<N> from_mean = x - m.x_mean;
    from_mean = from_mean - dot(from_mean, normal) * normal;
    const Vec<N> turned = normal - m.n_mean;
    set(in, m.variance, (1.0 - a) * (m.variance + a * norm2(from_mean)));
    set(in, m.covariance, (1.0 - a) * (m.covariance + a * dot(from_mean, turned)));
    set(in, m.x_mean, m.x_mean + a * (x - m.x_mean));
    set(in, m.n_mean, m.n_mean + a * turned);
    set(in, found.curvature, clamp(m.covariance / (m.variance + 4.5e-3 * 4.5e-3), all(-200.0), all(200.0)));
  }
  const Vec<N> last = found.normal;
  const V elastic = positive(dot(f, last) - m.damping * dot(v, last));
  set(in, found.point, x - (elastic / found.stiffness) * last);
}
/// SensorBias::learn where m.
template <int N>
static inline void learn_bias(const Parameters<V, N>& p, InternalModel<V, N>& m, M where, Vec<N> f) {
  const V most = 0.3 / p.force_scale;
  where &= ~(norm(f - m.bias) >= most);
  set(where, m.learned_s, least(all(1.0), m.learned_s + p.dt));
  const V weight = select(p.dt < m.learned_s, p.dt / m.learned_s, all(1.0));
  const Vec<N> next = m.bias + weight * (f - m.bias);
  set(where & (norm(next) <= most), m.bias, next);
}
/// InternalModelSlave::in_series.
template <int N>
static inline V in_series(const Parameters<V, N>& p, const InternalModel<V, N>& m) {
  return select(m.found.stiffness > 0.0, 1.0 / (1.0 / m.found.stiffness + 1.0 / p.coupling), V{});
}
/// InternalModelSlave::yield. `felt` in the master's units.
template <int N>
static inline void yield(const Parameters<V, N>& p, InternalModel<V, N>& m, M coupled, Vec<N> felt, V series) {
  const M yields = (m.informed != 0.0) & coupled & (m.contact != 0.0);
  V wanted{};
  if (any(yields)) {
    const Vec<N> n = m.found.normal;
    const M none = m.yield_m < 1e-6;
    const Vec<N> slow = m.yield_normal + p.weight_500ms * (n - m.yield_normal);
    set(yields, m.yield_normal, select(none, n, normalized(slow)));
    const V unfelt = dot(n, felt) + series * m.yield_m - dot(n, m.felt_rx);
    wanted = select(yields, positive(p.yields * unfelt / (700.0 + series)), V{});
  }
  low_pass(~M{}, m.yield_m, wanted, p.weight_50ms);
}
/// InternalModelSlave::leaving_brake. `v` in the master's world.
template <int N>
static inline Vec<N> leaving_brake(const Parameters<V, N>& p, const InternalModel<V, N>& m, Vec<N> v) {
  const Vec<N> n = m.found.normal;
  const Vec<N> leaving = least(V{}, dot(n, v)) * n;
  const V of_mass = 0.4 * root(m.found.stiffness / p.to_master_stiffness * p.robot_kg);
  const V b = most(p.brake, least(of_mass, p.robot_quarter_per_dt));
  return -b * (p.motion_scale * leaving);
}

// The master.

/// SurfaceModel::step where m.
template <int N>
static inline void follow_surface(const Parameters<V, N>& p, InternalModel<V, N>& m, M where) {
  const M touches = where & (m.contact_rx > 0.5), exists = where & (m.exists != 0.0);
  Patch<V, N> to = m.found_rx;
  const V size = norm(to.normal);
  const M valid = touches & (size > 1e-6) & (to.stiffness > 0.0);
  if (any(valid)) {
    to.normal = to.normal / size;
    to.stiffness = least(to.stiffness, all(1e6));
    to.friction = clamp(to.friction, V{}, all(1.0));
    to.curvature = clamp(to.curvature, all(-1e3), all(1e3));
    const M follows = valid & exists, adopts = valid & ~exists;
    if (any(follows)) {
      const V a = p.weight_50ms;
      const Depth<N> old = depth_at(m.model, to.point);
      const Vec<N> n = old.normal + a * (to.normal - old.normal);
      const V length = norm(n);
      set(follows, m.model.normal, select(length > 1e-3, n / length, to.normal));
      set(follows, m.model.point, to.point - ((1.0 - a) * old.depth) * old.normal);
      low_pass(follows, m.model.stiffness, to.stiffness, a);
      low_pass(follows, m.model.curvature, to.curvature, a);
      low_pass(follows, m.model.friction, to.friction, p.weight_100ms);
    }
    if (any(adopts)) [[unlikely]] {
      set(adopts, m.model.point, to.point), set(adopts, m.model.normal, to.normal);
      set(adopts, m.model.stiffness, to.stiffness), set(adopts, m.model.friction, to.friction);
      set(adopts, m.model.curvature, to.curvature);
      set(adopts, m.exists, all(1.0)), set(adopts, m.model_ramp, V{});
    }
  }
  const M leaves = exists & ~touches;
  V rise = p.ramp_in_100ms;
  if (any(leaves)) {
    const Depth<N> at = depth_at(m.model, m.robot_rx);
    const M forgets = leaves & (at.depth > 20e-3), gives = leaves & ~forgets & (at.depth > 2e-3);
    set(forgets, m.exists, V{}), set(forgets, m.model_ramp, V{});
    const V yielded_m = p.weight_20ms * (at.depth - 2e-3);
    set(gives, m.model.point, m.model.point + yielded_m * at.normal);
    set(gives & (yielded_m > 0.0), rise, -yielded_m / 20e-3);
  }
  set(where & (m.exists != 0.0), m.model_ramp, least(all(1.0), m.model_ramp + rise));
  const M passed = where & (m.exists != 0.0) & (m.model_ramp < 0.0);
  if (any(passed)) [[unlikely]]
    set(passed, m.exists, V{}), set(passed, m.model_ramp, V{});
}
/// SurfaceModel::force.
template <int N>
static inline Vec<N> model_force(const InternalModel<V, N>& m, const Depth<N>& at) {
  const M presses = (m.exists != 0.0) & ~(at.depth <= 0.0);
  return select(presses, (m.model.stiffness * at.depth) * at.normal, Vec<N>{});
}
/// StickSpring::step where m.
template <int N>
static inline Vec<N> stick(const Parameters<V, N>& p, M where, V& sticks, Vec<N>& anchor, Vec<N> y, Vec<N> normal,
                           V most) {
  if constexpr (N == 1) {
    return Vec<N>{};
  } else {
    const Vec<N> from = select(sticks != 0.0, anchor, y);
    set(where, sticks, all(1.0));
    Vec<N> e = y - from;
    e = e - dot(e, normal) * normal;
    e = e - p.weight_along * e;
    const V size = norm(e), longest = most / p.coupling;
    e = select(size > longest, (longest / size) * e, e);
    set(where, anchor, y - e);
    return p.coupling * e;
  }
}
/// EnergySpring::part_within, `error`: of the predicted velocity.
template <int N>
static inline V part_within(const Parameters<V, N>& p, const State<V, N>& s, Vec<N> f, V budget, V error,
                            Vec<N> beside) {
  const Vec<N> response = p.response * f;
  const V power = dot(f, s.predicted_w) - norm(f) * error - 2.0 * dot(beside, response);
  return feasible_scale(dot(f, response), -power, budget / p.dt);
}

/// InternalModelMaster::step, `moved` since the last tick under s.held. Sets f, wanted and what is dissipated and owed.
template <int N>
static inline void step_internal_model(const Parameters<V, N>& p, State<V, N>& s, Vec<N> moved, Vec<N>& f_out,
                                       Vec<N>& wanted_out, V& dissipated, V& undissipated) {
  InternalModel<V, N>& m = s.model;
  const M every = ~M{};
  // observe
  const V commanded = norm(m.commanded);
  const V part = select(commanded > 0.1, least(all(1.0), norm(s.held) / commanded), all(1.0));
  low_pass(every, m.shown, part, p.weight_20ms);
  const V net = s.master_absorbed - s.master_returned;
  m.energy += net - m.net;
  m.net = net;
  m.level = least(all(1e-5), m.level + part * dot(m.g, moved) + 1e-6 * p.dt);
  undissipated = positive(-(m.energy + p.initial_energy));

  const M shows = s.ramp != 0.0, heard = shows & (m.heard != 0.0);
  if (any(heard)) follow_surface(p, m, heard);
  const Vec<N> x = s.master_x;
  const Depth<N> hand = depth_at(m.model, x);
  const M exists = m.exists != 0.0, inside = exists & (hand.depth > 0.0);
  Vec<N> f_d{};
  if (any(heard)) {
    // SurfaceModel::stored
    const V deep = m.model_ramp * hand.depth;
    const V stored = select(exists & ~(hand.depth <= 0.0), 0.5 * m.model.stiffness * deep * deep, V{});
    set(heard, m.energy, least(m.energy, stored + 20e-3));
    // correct
    const Vec<N> f = p.force_scale * s.f_rx, echo = m.echo_rx;
    const Depth<N> at_echo = depth_at(m.model, echo);
    const Vec<N> modelled = model_force(m, at_echo), error = f - modelled;
    const M free = m.contact_rx < 0.5;
    const V pressed = p.coupling * norm(echo - m.robot_rx);
    const M in_flight = exists & (at_echo.depth > 0.0) & (pressed > 0.3);
    low_pass(heard, m.r, error, select(free & ~in_flight, p.weight_50ms, p.weight_residual));
    const Vec<N> n_echo = at_echo.normal;
    Vec<N> along = error - dot(error, n_echo) * n_echo;
    along = along - stick(p, heard & exists, m.sticks_at_echo, m.anchor_at_echo, echo, n_echo,
                          m.model.friction * norm(modelled));
    along = select(exists, along, Vec<N>{});
    set(heard & ~exists, m.sticks_at_echo, V{});
    set(heard, m.r_along, m.r_along + p.weight_along * (along - m.r_along));
    // displayed
    const M presses = heard & inside, apart = heard & exists & ~inside;
    const Vec<N> n = hand.normal, r = m.r;
    if (any(presses)) {
      const Vec<N> elastic = m.model_ramp * model_force(m, hand);
      const Vec<N> sum = elastic + dot(r, n) * n + m.r_along;
      f_d = select(presses, sum + stick(p, presses, m.sticks, m.anchor, x, n, m.model.friction * norm(elastic)), f_d);
    }
    if (any(apart)) {
      f_d = select(apart, most(V{}, 1.0 + hand.depth / 3e-3) * r, f_d);
      set(apart, m.sticks, V{});
    }
    f_d = select(heard & exists, f_d - least(V{}, dot(f_d, n)) * n, f_d);
  }
  const V cap = select(inside, least(all(1.0), p.quarter_handle / (p.dt2 * m.model.stiffness)), all(1.0));
  const Vec<N> wanted = select(shows, (s.ramp * cap) * f_d, Vec<N>{});
  const Vec<N> v = moved / p.dt;
  low_pass(shows, m.slow_v, v, p.weight_3ms);
  // damping
  const V of_delay = 2.0 * least(p.round_trip_s, all(1.0));
  const V b = select(inside, 0.5 + (of_delay + 10.0 * (1.0 - m.scale_slow)), all(0.5));
  const V b_normal = select(inside, 0.5 * p.dt * m.model.stiffness, V{});
  const Vec<N> slow = m.slow_v, n = hand.normal;
  const Vec<N> damping =
      s.ramp * (least(b, p.most_damping) * slow + (least(b_normal, p.most_damping) * dot(n, slow)) * n);
  // DamperAccount::apply
  const V available = positive(m.energy + p.initial_energy);
  const V share = clamp(2.0 * m.level / 1e-5, V{}, all(1.0));
  Vec<N> g = share * damping;
  g = part_within(p, s, g, m.level, s.predicted_error, Vec<N>{}) * g;
  g = part_within(p, s, g, least(available, all(1e-3)), s.predicted_worst, Vec<N>{}) * g;
  g = select(shows & (share != 0.0), g, Vec<N>{});
  m.g = g;
  // EnergySpring::scale
  const V reserved = positive((dot(g, p.response * g) - dot(g, s.predicted_w) + norm(g) * s.predicted_worst) * p.dt);
  const V a = positive(available - reserved), size = norm(wanted), most_n = root(2.0 * p.spring * a);
  const V s1 = select(size <= most_n, all(1.0), most_n / size);
  V scale = select(s1 == 0.0, V{}, s1 * part_within(p, s, s1 * wanted, a, s.predicted_worst, g));
  scale = select(size == 0.0, all(1.0), scale);
  low_pass(shows, m.scale_slow, scale, p.weight_20ms);
  const Vec<N> f = select(shows, scale * wanted + g, Vec<N>{});
  m.commanded = f;
  // move_set_point
  const M moves = shows & inside, out = shows & ~inside;
  const V missing = 1.0 - scale * m.shown * cap;
  if (any(moves)) {
    const Vec<N> normal = m.offset_normal;
    const Vec<N> next = select(m.offset_m < 1e-6, n, normalized(normal + p.weight_offset_normal * (n - normal)));
    set(moves, m.offset_normal, next);
    const V offset = missing * dot(f_d, n) / m.model.stiffness;
    low_pass(moves, m.offset_m, least(offset, hand.depth), p.weight_50ms);
  }
  low_pass(out, m.offset_m, V{}, p.weight_outside);
  // tell
  m.felt = select(shows, (scale * m.shown) * wanted, Vec<N>{});

  f_out = f;
  wanted_out = wanted;
  dissipated = select(shows, positive(-(1.0 - scale) * dot(wanted, v) * p.dt), V{});
}
