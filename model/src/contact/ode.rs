//! Steps of ordinary differential equations y' = f(y).

/// State of a system of N equations.
pub(crate) type State<const N: usize> = [f64; N];

/// y + dt times the sum of weight k over `terms`.
fn add<const N: usize>(y: &State<N>, dt: f64, terms: &[(f64, &State<N>)]) -> State<N> {
    std::array::from_fn(|i| y[i] + dt * terms.iter().map(|(w, k)| w * k[i]).sum::<f64>())
}

/// One step of the classical fourth-order method.
pub(crate) fn runge_kutta_4<const N: usize>(f: impl Fn(&State<N>) -> State<N>, y: &State<N>, dt: f64) -> State<N> {
    let k_1 = f(y);
    let k_2 = f(&std::array::from_fn(|i| y[i] + 0.5 * dt * k_1[i]));
    let k_3 = f(&std::array::from_fn(|i| y[i] + 0.5 * dt * k_2[i]));
    let k_4 = f(&std::array::from_fn(|i| y[i] + dt * k_3[i]));
    std::array::from_fn(|i| y[i] + dt / 6.0 * (k_1[i] + 2.0 * (k_2[i] + k_3[i]) + k_4[i]))
}

/// One step of Dormand and Prince's fifth-order method, with its estimate of the error (J. Comp. Appl. Math. 6 (1980) 19).
pub(crate) fn dormand_prince<const N: usize>(
    f: impl Fn(&State<N>) -> State<N>,
    y: &State<N>,
    dt: f64,
) -> (State<N>, State<N>) {
    let k_1 = f(y);
    let k_2 = f(&add(y, dt, &[(1.0 / 5.0, &k_1)]));
    let k_3 = f(&add(y, dt, &[(3.0 / 40.0, &k_1), (9.0 / 40.0, &k_2)]));
    let k_4 = f(&add(y, dt, &[(44.0 / 45.0, &k_1), (-56.0 / 15.0, &k_2), (32.0 / 9.0, &k_3)]));
    let k_5 = f(&add(
        y,
        dt,
        &[(19372.0 / 6561.0, &k_1), (-25360.0 / 2187.0, &k_2), (64448.0 / 6561.0, &k_3), (-212.0 / 729.0, &k_4)],
    ));
    let k_6 = f(&add(
        y,
        dt,
        &[
            (9017.0 / 3168.0, &k_1),
            (-355.0 / 33.0, &k_2),
            (46732.0 / 5247.0, &k_3),
            (49.0 / 176.0, &k_4),
            (-5103.0 / 18656.0, &k_5),
        ],
    ));
    let next = add(
        y,
        dt,
        &[
            (35.0 / 384.0, &k_1),
            (500.0 / 1113.0, &k_3),
            (125.0 / 192.0, &k_4),
            (-2187.0 / 6784.0, &k_5),
            (11.0 / 84.0, &k_6),
        ],
    );
    let k_7 = f(&next);
    let error = add(
        &[0.0; N],
        dt,
        &[
            (71.0 / 57600.0, &k_1),
            (-71.0 / 16695.0, &k_3),
            (71.0 / 1920.0, &k_4),
            (-17253.0 / 339_200.0, &k_5),
            (22.0 / 525.0, &k_6),
            (-1.0 / 40.0, &k_7),
        ],
    );
    (next, error)
}

/// One accepted step: its beginning, its end, and its duration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step<const N: usize> {
    pub t: f64,
    pub dt: f64,
    pub from: State<N>,
    pub to: State<N>,
}

/// How to choose the steps of an integration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stepping {
    /// Allowed error per step: absolute for values below 1, relative above. Choose units in which the state is near 1.
    pub tolerance: f64,
    /// Longest step.
    pub dt_max: f64,
    /// First step.
    pub dt_first: f64,
    /// Largest number of steps, rejected ones included.
    pub steps_max: usize,
}

/// Where an integration ended.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reached {
    pub t: f64,
    pub steps: usize,
}

/// Integrates from 0 to `t_end`; calls `observe` after each accepted step, and stops if it returns false.
pub(crate) fn integrate<const N: usize>(
    f: impl Fn(&State<N>) -> State<N>,
    y: State<N>,
    t_end: f64,
    stepping: &Stepping,
    mut observe: impl FnMut(&Step<N>) -> bool,
) -> Reached {
    let (mut t, mut from, mut dt) = (0.0, y, stepping.dt_first);
    for steps in 0..stepping.steps_max {
        if t >= t_end {
            return Reached { t, steps };
        }
        dt = if dt > stepping.dt_max { stepping.dt_max } else { dt };
        let is_last = t + dt >= t_end;
        let length = if is_last { t_end - t } else { dt };
        let (to, error) = dormand_prince(&f, &from, length);
        let share = worst_ratio(&from, &to, &error, stepping.tolerance);
        if share <= 1.0 {
            let step = Step { t, dt: length, from, to };
            (t, from) = (if is_last { t_end } else { t + length }, to);
            if !observe(&step) {
                return Reached { t, steps: steps + 1 };
            }
        }
        // The error of a step goes with dt^5; the factor 0.9 makes most next steps acceptable. A NaN or infinite ratio
        // is an overflow within the step: it calls for the shortest step.
        dt = length * if share.is_finite() { (0.9 * share.powf(-0.2)).clamp(0.2, 5.0) } else { 0.2 };
    }
    Reached { t, steps: stepping.steps_max }
}

/// The largest error relative to the allowed one; infinite if one is NaN.
fn worst_ratio<const N: usize>(from: &State<N>, to: &State<N>, error: &State<N>, tolerance: f64) -> f64 {
    let mut worst = 1e-10;
    for i in 0..N {
        let size = if from[i].abs() > to[i].abs() { from[i].abs() } else { to[i].abs() };
        let share = error[i].abs() / (tolerance * (1.0 + size));
        if share.is_nan() || to[i].is_nan() {
            return f64::INFINITY;
        }
        worst = if share > worst { share } else { worst };
    }
    worst
}

/// The time within `step` at which `is_before` turns false, and the state there; by bisection.
pub(crate) fn locate<const N: usize>(
    f: impl Fn(&State<N>) -> State<N>,
    step: &Step<N>,
    is_before: impl Fn(&State<N>) -> bool,
) -> (f64, State<N>) {
    const HALVINGS: usize = 60;
    let (mut low, mut high) = (0.0, step.dt);
    let mut at_low = step.from;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let (y, _) = dormand_prince(&f, &step.from, middle);
        if is_before(&y) { (low, at_low) = (middle, y) } else { high = middle }
    }
    (step.t + low, at_low)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn oscillator(y: &State<2>) -> State<2> {
        [y[1], -y[0]]
    }

    /// Catches a wrong coefficient: the error must fall with the order of the method.
    #[test]
    fn methods_have_their_order() {
        let error_of = |halvings: u32, is_fifth: bool| {
            let steps = 8 << halvings;
            let dt = 1.0 / f64::from(steps);
            let y = (0..steps).fold([1.0, 0.0], |y, _| {
                if is_fifth { dormand_prince(oscillator, &y, dt).0 } else { runge_kutta_4(oscillator, &y, dt) }
            });
            (y[0] - 1.0_f64.cos()).abs()
        };
        assert!((error_of(1, false) / error_of(2, false)).log2() > 3.8);
        assert!((error_of(1, true) / error_of(2, true)).log2() > 4.8);
    }

    /// Catches an error estimate that is not the method's: it must fall with dt^5.
    #[test]
    fn the_error_estimate_has_its_order() {
        let estimate = |dt: f64| dormand_prince(oscillator, &[1.0, 0.5], dt).1[0].abs();
        assert!((estimate(0.2) / estimate(0.1)).log2() > 4.5);
    }

    /// Catches steps that exceed the tolerance, an end that is missed, and an event placed at a step's end.
    #[test]
    fn steps_end_on_time_and_events_are_found() {
        let stepping = Stepping { tolerance: 1e-12, dt_max: 0.3, dt_first: 1e-3, steps_max: 100_000 };
        let (mut crossing, mut end) = (f64::NAN, [0.0; 2]);
        let reached = integrate(oscillator, [1.0, 0.0], 20.0, &stepping, |step| {
            if crossing.is_nan() && step.to[0] <= 0.0 {
                crossing = locate(oscillator, step, |y| y[0] > 0.0).0;
            }
            end = step.to;
            true
        });
        assert!((end[0] - 20.0_f64.cos()).abs() < 1e-10);
        assert!((reached.t - 20.0).abs() < 1e-15);
        assert!((crossing - 0.5 * PI).abs() < 1e-11);
    }

    /// Catches an integration that never ends.
    #[test]
    fn steps_are_capped() {
        let stepping = Stepping { tolerance: 1e-12, dt_max: 1.0, dt_first: 1.0, steps_max: 50 };
        let reached = integrate(|y: &State<1>| [-1e9 * y[0] + f64::NAN], [1.0], 1.0, &stepping, |_| true);
        assert_eq!(reached.steps, 50);
        assert!(reached.t < 1.0);
    }
}
