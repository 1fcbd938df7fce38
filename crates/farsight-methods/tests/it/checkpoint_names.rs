//! The naming rules against the table of the specification, which was read off the real modules.

use farsight_methods::smoke::import::{ImagenetNorms, Layout, canonical_names, is_dead, running_statistics};

/// One row of `statedict_map.csv`.
struct Row {
    official: String,
    mmdet3d: String,
    imagenet: String,
    official_loads: bool,
    used: bool,
}

/// The table, or none with a word to the reader of the test's output.
fn table() -> Option<Vec<Row>> {
    let path = farsight_testing::folder("FARSIGHT_SPEC", "../shared/spec", "")?.join("statedict_map.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let mut fields = line.split(',').map(str::to_owned);
        let mut field = || fields.next().unwrap();
        let (official, mmdet3d, imagenet) = (field(), field(), field());
        let official_loads = field() == "yes";
        let _shape = field();
        Row { official, mmdet3d, imagenet, official_loads, used: field() == "yes" }
    };
    Some(text.lines().skip(1).map(row).collect())
}

#[test]
fn there_are_233_parameters_and_6_of_them_are_dead() {
    let names = canonical_names();
    assert_eq!(names.len(), 233);
    // The outer projections of levels 3 and 4: a convolution and a norm's weight and bias each.
    assert_eq!(names.iter().filter(|name| is_dead(name)).count(), 6);
    // 55 norms that the forward pass uses, as the golden statistics have them, and the two dead ones.
    assert_eq!(running_statistics().iter().filter(|name| !is_dead(name)).count(), 2 * 55);
}

#[test]
fn every_row_of_the_table_maps() {
    let Some(rows) = table() else { return };
    let mut official: Vec<&str> = rows.iter().map(|row| row.official.as_str()).collect();
    official.sort_unstable();
    assert_eq!(canonical_names(), official);
    for row in &rows {
        let canonical = Some(row.official.clone());
        for norms in [ImagenetNorms::AsOfficial, ImagenetNorms::All] {
            assert_eq!(Layout::OfficialSmoke.canonical_name(&row.official, norms), canonical);
            assert_eq!(Layout::Mmdet3d.canonical_name(&row.mmdet3d, norms), canonical, "{}", row.mmdet3d);
        }
        assert_eq!(is_dead(&row.official), !row.used, "{}", row.official);
    }
}

#[test]
fn imagenet_names_map_as_the_official_loader_does_or_all() {
    let Some(rows) = table() else { return };
    let backbone: Vec<&Row> = rows.iter().filter(|row| !row.imagenet.is_empty()).collect();
    assert_eq!(backbone.len(), 117);
    assert_eq!(backbone.iter().filter(|row| row.official_loads).count(), 57);
    for row in backbone {
        let mapped = |norms| Layout::ImagenetDla34.canonical_name(&row.imagenet, norms);
        assert_eq!(mapped(ImagenetNorms::All).as_ref(), Some(&row.official));
        assert_eq!(mapped(ImagenetNorms::AsOfficial), row.official_loads.then(|| row.official.clone()));
    }
}

#[test]
fn each_layout_is_told_by_its_names() {
    let Some(rows) = table() else { return };
    let detect = |name: fn(&Row) -> &str| Layout::detect(rows.iter().map(name).filter(|name| !name.is_empty()));
    assert_eq!(detect(|row| &row.official), Some(Layout::OfficialSmoke));
    assert_eq!(detect(|row| &row.mmdet3d), Some(Layout::Mmdet3d));
    assert_eq!(detect(|row| &row.imagenet), Some(Layout::ImagenetDla34));
    assert_eq!(Layout::detect(["conv1.weight", "layer1.0.bn1.bias"].into_iter()), None);
}

#[test]
fn batch_norm_builds_and_strangers() {
    let rows = [
        (
            Layout::Mmdet3d,
            "neck.dla_up.ida_2.nodes.2.bn.running_var",
            Some("backbone.body.dla_up.ida_2.node_3.norm.running_var"),
        ),
        (
            Layout::Mmdet3d,
            "bbox_head.conv_reg_prevs.0.0.bn.running_mean",
            Some("heads.predictor.regression_head.1.running_mean"),
        ),
        (
            Layout::Mmdet3d,
            "backbone.level5.root.norm.running_var",
            Some("backbone.body.base.level5.root.norm.running_var"),
        ),
        (Layout::Mmdet3d, "neck.ida_up.nodes.0.bn.num_batches_tracked", None),
        (Layout::Mmdet3d, "neck.ida_up.nodes.2.gn.weight", None),
        (Layout::Mmdet3d, "neck.ida_up.nodes.99999999999999999999.gn.weight", None),
        (Layout::Mmdet3d, "neck.ida_up.ups.0.bias", None),
        (Layout::Mmdet3d, "bbox_head.conv_cls.extra.weight", None),
        (Layout::OfficialSmoke, "heads.loss_evaluator.weight", None),
        (Layout::OfficialSmoke, "backbone.body.base.level0.0.running_mean", None),
        (Layout::ImagenetDla34, "fc.weight", None),
        (Layout::ImagenetDla34, "base_layer.1.running_mean", None),
        (Layout::ImagenetDla34, "nodots", None),
    ];
    for (layout, name, expected) in rows {
        assert_eq!(layout.canonical_name(name, ImagenetNorms::All).as_deref(), expected, "{name}");
    }
}
