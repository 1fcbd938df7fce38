#![allow(clippy::unwrap_used)]

use std::collections::HashSet;

use super::{REGIONS, Region, VehicleKind};
use crate::rng::SceneRng;

/// Nobody tuned anything to scenes of this seed.
const HELD_OUT: u64 = 90_210;
const DRAWS: u64 = 4000;

fn regions() -> impl Iterator<Item = (&'static str, &'static Region)> {
    REGIONS.iter().map(|(name, region)| (*name, region.as_ref().unwrap()))
}

fn of_table(measure: usize, kind: &VehicleKind) -> [f64; 3] {
    [kind.length_m, kind.width_m, kind.height_m][measure]
}

#[test]
fn every_region_drives_at_least_eight_shapes() {
    for (name, region) in regions() {
        let mut rng = SceneRng::new(HELD_OUT, 0, 0);
        let drawn = (0..DRAWS).map(|_| region.vehicle(|_| 1.0, &mut rng).unwrap().kind.unwrap());
        let shapes: HashSet<_> = drawn.map(|kind| kind.shape).collect();
        assert!(shapes.len() >= 8, "{name}: {shapes:?}");
    }
}

#[test]
fn sizes_are_spread_as_the_table_of_the_region_says() {
    for (name, region) in regions() {
        for (row, kind) in region.vehicles.iter().enumerate() {
            let mut rng = SceneRng::new(HELD_OUT, row as u64, 1);
            let sizes: Vec<_> = (0..DRAWS).map(|_| kind.sample(&mut rng)).collect();
            let columns = [
                sizes.iter().map(|size| size.length).collect::<Vec<f64>>(),
                sizes.iter().map(|size| size.width).collect(),
                sizes.iter().map(|size| size.height).collect(),
            ];
            for (measure, mut values) in columns.into_iter().enumerate() {
                values.sort_by(f64::total_cmp);
                let [least, median, most] = of_table(measure, kind);
                let at = |share: f64| values[(share * DRAWS as f64) as usize];
                let tolerance = 0.06 * (most - least).max(0.001);
                assert!(values[0] >= least - 1e-9 && values[values.len() - 1] <= most + 1e-9, "{name}: {}", kind.name);
                for (share, expected) in [(0.02, least), (0.5, median), (0.98, most)] {
                    let found = at(share);
                    assert!(
                        (found - expected).abs() < tolerance,
                        "{name}: {}: measure {measure}: {found} at {share}, the table has {expected}",
                        kind.name
                    );
                }
            }
        }
    }
}

#[test]
fn kinds_are_drawn_as_often_as_the_table_says() {
    for (name, region) in regions() {
        let mut rng = SceneRng::new(HELD_OUT, 0, 2);
        let drawn: Vec<_> = (0..DRAWS).map(|_| region.vehicle(|_| 1.0, &mut rng).unwrap().kind.unwrap()).collect();
        let total: f64 = region.vehicles.iter().map(|kind| kind.share).sum();
        for kind in &region.vehicles {
            let expected = kind.share / total;
            let found = drawn.iter().filter(|k| k.name == kind.name).count() as f64 / DRAWS as f64;
            // Five standard deviations of a binomial.
            let tolerance = 5.0 * (expected * (1.0 - expected) / DRAWS as f64).sqrt();
            assert!((found - expected).abs() < tolerance, "{name}: {}: {found}, expected {expected}", kind.name);
        }
    }
}

#[test]
fn a_labelled_size_gets_a_kind_that_has_such_sizes() {
    for (name, region) in regions() {
        let mut rng = SceneRng::new(HELD_OUT, 0, 3);
        for kind in &region.vehicles {
            let size = kind.sample(&mut rng);
            let found: Vec<_> = (0..20).map(|_| region.kind_of(&kind.class(), size, &mut rng).unwrap()).collect();
            let is_like =
                |found: &VehicleKind| (0.85 * found.length_m[0]..1.15 * found.length_m[2]).contains(&size.length);
            assert!(
                found.iter().all(|found| is_like(found)),
                "{name}: {} of {size:?} became {:?}",
                kind.name,
                found[0].name
            );
        }
        let elsewhere =
            region.kind_of(&farsight_core::ObjectClass::Pedestrian, region.vehicles[0].sample(&mut rng), &mut rng);
        assert_eq!(elsewhere, None);
    }
}

#[test]
fn tables_that_are_wrong_say_where() {
    let text = super::TABLES[0].1;
    let broken = [
        (text.replacen("shape = \"hatchback\"", "shape = \"hovercraft\"", 1), "hovercraft"),
        (text.replacen("length_m = [3.5, 4.0, 4.15]", "length_m = [4.5, 4.0, 4.15]", 1), "small car: length_m"),
        (text.replacen("class = \"Car\"", "class = \"Kar\"", 1), "small car: its class"),
        (text.replacen("lines = 1", "lines = 0", 1), "a plate of 0 lines"),
    ];
    for (text, expected) in broken {
        let problem = super::parsed(&text).unwrap_err();
        assert!(problem.contains(expected), "{problem}");
    }
    assert!(Region::named("atlantis").unwrap_err().contains("no region"));
}
