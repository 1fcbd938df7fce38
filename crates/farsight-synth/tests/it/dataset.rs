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
