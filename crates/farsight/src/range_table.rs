//! The table that `range` prints: one row a vehicle.

use farsight_core::{Box2d, Box3d, Detection};
use farsight_viz::distance_text;

/// Columns of the table; the first is as wide as the longest name.
pub(crate) struct RangeTable {
    name_width: usize,
    range_m: fn(&Box3d) -> f64,
}

impl RangeTable {
    /// A table for images with these names.
    pub(crate) fn new(names: &[String], range_m: fn(&Box3d) -> f64) -> Self {
        let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
        Self { name_width: longest.max("image".len()), range_m }
    }

    /// The names of the columns.
    pub(crate) fn heading(&self) -> String {
        self.row("image", "class", "score", "distance", "x", "box (left top right bottom)")
    }

    /// The rows of one image; one that says so when it has no detection.
    pub(crate) fn rows(&self, name: &str, detections: &[Detection]) -> Vec<String> {
        if detections.is_empty() {
            return vec![self.row(name, "-", "", "", "", "")];
        }
        detections.iter().map(|detection| self.detection(name, detection)).collect()
    }

    fn detection(&self, name: &str, detection: &Detection) -> String {
        let distance = distance_text(detection, (self.range_m)(&detection.box3d));
        let score = format!("{:.2}", detection.score);
        let x = format!("{:.1} m", detection.box3d.location[0]);
        let Box2d { x1, y1, x2, y2 } = detection.box2d;
        let area = format!("{x1:.0} {y1:.0} {x2:.0} {y2:.0}");
        self.row(name, detection.class.name(), &score, &distance, &x, &area)
    }

    fn row(&self, name: &str, class: &str, score: &str, distance: &str, x: &str, area: &str) -> String {
        let width = self.name_width;
        let row = format!("{name:width$}  {class:10}  {score:>5}  {distance:>12}  {x:>8}  {area}");
        row.trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use farsight_core::{Box2d, Box3d, Detection, Dimensions, ObjectClass};

    use super::RangeTable;

    fn car() -> Detection {
        Detection {
            class: ObjectClass::Car,
            score: 0.913,
            box2d: Box2d::new(853.6, 185.2, 1015.0, 337.9),
            box3d: Box3d {
                dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 },
                location: [-12.31, 1.65, 8.62],
                yaw: 0.0,
            },
            range_sigma_m: None,
        }
    }

    #[test]
    fn an_error_bar_is_that_of_the_distance_that_is_given() {
        let aside = Detection { range_sigma_m: Some(1.0), ..car() };
        let text = |range_m: fn(&Box3d) -> f64| {
            RangeTable::new(&[], range_m).rows("aside", std::slice::from_ref(&aside)).concat()
        };
        assert!(text(Box3d::depth_m).contains("8.6 ±1.0 m"), "{}", text(Box3d::depth_m));
        // As far off as the depth: sqrt(12.31² + 1.65² + 8.62²) / 8.62.
        let euclidean = |object: &Box3d| object.location.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(text(euclidean).contains("15.1 ±1.8 m"), "{}", text(euclidean));
    }

    #[test]
    fn columns_line_up() {
        let car = car();
        let far = Detection { range_sigma_m: Some(1.26), class: ObjectClass::Pedestrian, ..car.clone() };
        let table = RangeTable::new(&["000032".to_owned()], Box3d::depth_m);
        let mut lines = vec![table.heading()];
        lines.extend(table.rows("000032", &[car, far]));
        lines.extend(table.rows("000033", &[]));
        let expected = "\
image   class       score      distance         x  box (left top right bottom)
000032  Car          0.91         8.6 m   -12.3 m  854 185 1015 338
000032  Pedestrian   0.91    8.6 ±1.3 m   -12.3 m  854 185 1015 338
000033  -";
        assert_eq!(lines.join("\n"), expected);
    }
}
