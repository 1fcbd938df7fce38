//! Rendered scenes as a data set.

use std::sync::Arc;

use farsight_data::annotations::{DepthMap, Plates};
use farsight_data::dataset::check_laws;
use farsight_data::{Dataset, ItemKey};
use farsight_synth::{SceneConfig, SceneDataset, SceneStream};

#[test]
fn the_laws_of_data_sets_hold_and_epochs_go_through_the_stream() {
    let stream = SceneStream { config: SceneConfig::default(), seed: 11 };
    let dataset: Arc<dyn Dataset> = Arc::new(SceneDataset::new(stream.clone(), 3));
    assert_eq!(check_laws(&dataset, 1).unwrap(), None);
    assert!(dataset.has::<Plates>() && dataset.has::<DepthMap>() && dataset.is_endless());
    assert_eq!(dataset.ids(), ["000000", "000001", "000002"]);
    let item = dataset.item(ItemKey { epoch: 2, index: 1, seed: 9 }).unwrap();
    assert_eq!((item.id.as_str(), &*item), ("000007", &stream.frame(7)));
}

/// With three views a new scene comes every third time, the others are of 256 and 512 scenes before.
#[test]
fn views_are_the_same_scenes_again_hundreds_of_scenes_later() {
    let stream = SceneStream { config: SceneConfig::default(), seed: 11 };
    let dataset = SceneDataset::new(stream.clone(), 1000).with_views(3);
    let at = |place: usize| dataset.item(ItemKey { epoch: place as u64 / 1000, index: place % 1000, seed: 9 }).unwrap();
    let first = at(1_500);
    assert_eq!(*first, stream.frame(500));
    // Kept until the last of its views, not rendered again.
    assert!(Arc::ptr_eq(&first, &at(1_500 + 3 * 256 + 1)) && Arc::ptr_eq(&first, &at(1_500 + 3 * 512 + 2)));
    // Nothing is kept for longer, and what is asked for out of order is the same all the same.
    assert_eq!(at(1_500 + 3 * 1_000).id, "001500");
    assert!(!Arc::ptr_eq(&first, &at(1_500)) && at(1_500) == first);
    // The first scenes of a run have none before them.
    assert_eq!(at(1).id, "000000");
}
