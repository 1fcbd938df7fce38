//! The table that `range` prints: one row a vehicle.

use farsight::{Box2d, DetectedObject, Detection};
use farsight_viz::distance_text;

/// Columns of the table; the first is as wide as the longest name.
pub(crate) struct RangeTable {
    name_width: usize,
}

impl RangeTable {
    /// A table for images with these names.
    pub(crate) fn new(names: &[String]) -> Self {
        let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
        Self { name_width: longest.max("image".len()) }
    }

    /// The names of the columns.
    pub(crate) fn heading(&self) -> String {
        self.row("image", "class", "score", "distance", "x", "box (left top right bottom)")
    }

    /// The rows of one image; one that says so when it has no detection.
    pub(crate) fn rows(&self, name: &str, objects: &[DetectedObject]) -> Vec<String> {
        if objects.is_empty() {
            return vec![self.row(name, "-", "", "", "", "")];
        }
        objects.iter().map(|object| self.object(name, object)).collect()
    }

    fn object(&self, name: &str, object: &DetectedObject) -> String {
        let distance = distance_text(&Detection::from(object.clone()), object.range_m);
        let score = format!("{:.2}", object.score);
        let x = format!("{:.1} m", object.box3d.location[0]);
        let Box2d { x1, y1, x2, y2 } = object.box2d;
        let area = format!("{x1:.0} {y1:.0} {x2:.0} {y2:.0}");
        self.row(name, object.class.name(), &score, &distance, &x, &area)
    }

    fn row(&self, name: &str, class: &str, score: &str, distance: &str, x: &str, area: &str) -> String {
        let width = self.name_width;
        let row = format!("{name:width$}  {class:10}  {score:>5}  {distance:>12}  {x:>8}  {area}");
        row.trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use farsight::{Box2d, Box3d, DetectedObject, Detection, ObjectClass, RangeKind};
    use farsight_core::Dimensions;
    use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;

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
        let text = |range| {
            RangeTable::new(&[])
                .rows("aside", &[DetectedObject::new(aside.clone(), range, NORMAL_INTERVAL_SIGMAS)])
                .concat()
        };
        assert!(text(RangeKind::Depth).contains("8.6 ±1.0 m"), "{}", text(RangeKind::Depth));
        // As far off as the depth: sqrt(12.31² + 1.65² + 8.62²) / 8.62.
        // The middle of the box is half its height farther up: sqrt(12.31² + 0.9² + 8.62²).
        assert!(text(RangeKind::Euclidean).contains("15.1 ±1.7 m"), "{}", text(RangeKind::Euclidean));
    }

    #[test]
    fn columns_line_up() {
        let car = car();
        let far = Detection { range_sigma_m: Some(1.26), class: ObjectClass::Pedestrian, ..car.clone() };
        let table = RangeTable::new(&["000032".to_owned()]);
        let mut lines = vec![table.heading()];
        let objects =
            [car, far].map(|detection| DetectedObject::new(detection, RangeKind::Depth, NORMAL_INTERVAL_SIGMAS));
        lines.extend(table.rows("000032", &objects));
        lines.extend(table.rows("000033", &[]));
        let expected = "\
image   class       score      distance         x  box (left top right bottom)
000032  Car          0.91         8.6 m   -12.3 m  854 185 1015 338
000032  Pedestrian   0.91    8.6 ±1.3 m   -12.3 m  854 185 1015 338
000033  -";
        assert_eq!(lines.join("\n"), expected);
    }
}
