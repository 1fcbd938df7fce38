//! The learning rate over a run: values worked out by hand.

use farsight_train::schedule::Schedule;

const TOLERANCE: f64 = 1e-12;

#[track_caller]
fn assert_factors(schedule: &Schedule, steps: u64, warm_up: u64, rows: &[(u64, f64)]) {
    for &(step, expected) in rows {
        let found = schedule.factor(step, steps, warm_up);
        assert!((found - expected).abs() <= TOLERANCE, "step {step} of {steps}: {found}, expected {expected}");
    }
}

#[test]
fn cosine_falls_to_zero() {
    let root = |number: f64| number.sqrt();
    let eighths = [
        1.0,
        // cos(pi / 8) is half the root of two plus the root of two.
        0.5 + 0.25 * root(2.0 + root(2.0)),
        0.5 + 0.25 * root(2.0),
        0.5 + 0.25 * root(2.0 - root(2.0)),
        0.5,
        0.5 - 0.25 * root(2.0 - root(2.0)),
        0.5 - 0.25 * root(2.0),
        0.5 - 0.25 * root(2.0 + root(2.0)),
        0.0,
    ];
    let rows: Vec<(u64, f64)> = (0..).zip(eighths).collect();
    assert_factors(&Schedule::Cosine, 8, 0, &rows);
    // A run that goes on beyond its end stays at the end.
    assert_factors(&Schedule::Cosine, 8, 0, &[(9, 0.0), (1000, 0.0)]);
}

#[test]
fn steps_divide_by_ten() {
    let schedule = Schedule::Steps { at: vec![0.4, 0.72] };
    let rows = [(0, 1.0), (39, 1.0), (40, 0.1), (71, 0.1), (72, 0.01), (99, 0.01)];
    assert_factors(&schedule, 100, 0, &rows);
    assert_factors(&Schedule::Steps { at: vec![] }, 100, 0, &[(0, 1.0), (99, 1.0)]);
}

#[test]
fn constant_is_constant() {
    assert_factors(&Schedule::Constant, 100, 0, &[(0, 1.0), (50, 1.0), (99, 1.0)]);
}

#[test]
fn warm_up_rises_in_a_line_and_the_schedule_fills_what_is_left() {
    let rise = [(0, 0.2), (1, 0.4), (2, 0.6), (3, 0.8), (4, 1.0)];
    for schedule in [Schedule::Cosine, Schedule::Constant, Schedule::Steps { at: vec![0.4, 0.72] }] {
        assert_factors(&schedule, 105, 5, &rise);
    }
    let quarter = 0.5 + 0.25 * 2.0_f64.sqrt();
    assert_factors(&Schedule::Cosine, 105, 5, &[(5, 1.0), (5 + 25, quarter), (55, 0.5), (105, 0.0)]);
    assert_factors(&Schedule::Constant, 105, 5, &[(5, 1.0), (104, 1.0)]);
    let at = Schedule::Steps { at: vec![0.4, 0.72] };
    assert_factors(&at, 105, 5, &[(5, 1.0), (44, 1.0), (45, 0.1), (76, 0.1), (77, 0.01)]);
}

#[test]
fn a_run_shorter_than_its_warm_up_only_rises() {
    assert_factors(&Schedule::Cosine, 3, 10, &[(0, 0.1), (1, 0.2), (2, 0.3)]);
    // And when they are equally long, nothing is left for the schedule.
    assert_factors(&Schedule::Cosine, 10, 10, &[(9, 1.0)]);
}
