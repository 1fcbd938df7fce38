//! What the tensors of known checkpoints are called, and what Farsight calls them.
//!
//! Farsight's canonical names are those of official SMOKE. The rules here are those of spec section 13; nothing is
//! looked up in a table of whole names, so that narrower and wider networks of the same build map too.

pub(super) mod efficientnet_lite;
pub(super) mod mobilenet_v2;

use std::collections::BTreeSet;
use std::sync::LazyLock;

/// Whose names a checkpoint uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// `lzccccc/SMOKE`, the code of the paper's authors.
    OfficialSmoke,
    /// SMOKE of `open-mmlab/mmdetection3d`.
    Mmdet3d,
    /// DLA-34 trained on ImageNet, as the authors of DLA published it: the backbone alone.
    ImagenetDla34,
    /// `MobileNetV2` as torchvision names it.
    MobilenetV2,
    /// `MobileNetV2` as torchvision and the repositories before it named it first: the layers of a block in one row,
    /// activations counted.
    MobilenetV2InRows,
    /// `MobileNetV2` in TensorFlow's object detection, batch norms folded, as TFLite files have it.
    MobilenetV2Tensorflow,
    /// `EfficientNet-Lite` as `efficientnet_lite_pytorch` names it.
    EfficientnetLite,
}

/// A layer of `EfficientNet` that `EfficientNet-Lite` does not have.
const SQUEEZE: &str = "._se_reduce.";

/// How ImageNet's batch norms start the norms of our backbone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ImagenetNorms {
    /// As the official loader does: only norms with the same name in both, 57 tensors with the convolutions. The norms
    /// of blocks and roots are called `bn` there and `norm` here; they start at 1 and 0, and that is how the published
    /// models were trained.
    #[default]
    AsOfficial,
    /// Every affine term: all 117 tensors.
    All,
}

/// Where the backbone's tensors are in the canonical names.
const BASE: &str = "backbone.body.base.";

/// mmdetection3d's head modules and the canonical ones. Group norm is `gn` there, batch norm would be `bn`.
const HEADS: [(&str, &str); 8] = [
    ("conv_cls_prev.0.conv", "class_head.0"),
    ("conv_cls_prev.0.gn", "class_head.1"),
    ("conv_cls_prev.0.bn", "class_head.1"),
    ("conv_cls", "class_head.3"),
    ("conv_reg_prevs.0.0.conv", "regression_head.0"),
    ("conv_reg_prevs.0.0.gn", "regression_head.1"),
    ("conv_reg_prevs.0.0.bn", "regression_head.1"),
    ("conv_regs.0", "regression_head.3"),
];

/// Modules of mmdetection3d's deformable units and the canonical ones.
const UNITS: [(&str, &str); 4] =
    [("conv.conv_offset", "deform_conv.conv_offset_mask"), ("conv", "deform_conv"), ("gn", "norm"), ("bn", "norm")];

impl Layout {
    /// The layout that these names belong to, told by a name that no other layout has.
    pub fn detect<'a>(mut names: impl Iterator<Item = &'a str> + Clone) -> Option<Self> {
        let signs = [
            ("backbone.body.base.", Self::OfficialSmoke),
            ("backbone.base_layer.", Self::Mmdet3d),
            ("base_layer.", Self::ImagenetDla34),
            ("FeatureExtractor/MobilenetV2/", Self::MobilenetV2Tensorflow),
            ("features.1.conv.0.0.", Self::MobilenetV2),
            ("features.1.conv.0.", Self::MobilenetV2InRows),
            ("_blocks.0._depthwise_conv.", Self::EfficientnetLite),
        ];
        if names.clone().any(|name| name.contains(SQUEEZE)) {
            return None;
        }
        names.find_map(|name| signs.iter().find(|(sign, _)| name.starts_with(sign))).map(|(_, layout)| *layout)
    }

    /// Short name, as metadata and reports carry it.
    pub fn name(self) -> &'static str {
        match self {
            Self::OfficialSmoke => "official-smoke",
            Self::Mmdet3d => "mmdet3d",
            Self::ImagenetDla34 => "imagenet-dla34",
            Self::MobilenetV2 => "mobilenet-v2",
            Self::MobilenetV2InRows => "mobilenet-v2-in-rows",
            Self::MobilenetV2Tensorflow => "mobilenet-v2-tensorflow",
            Self::EfficientnetLite => "efficientnet-lite",
        }
    }

    /// Farsight's name of a tensor; none for tensors that Farsight has no place for, ImageNet's classifier for
    /// instance.
    ///
    /// ```
    /// use farsight_methods::smoke::import::{ImagenetNorms, Layout};
    /// let ours = Layout::Mmdet3d.canonical_name("neck.ida_up.projs.0.gn.bias", ImagenetNorms::default());
    /// assert_eq!(ours.as_deref(), Some("backbone.body.ida_up.proj_1.norm.bias"));
    /// ```
    pub fn canonical_name(self, name: &str, norms: ImagenetNorms) -> Option<String> {
        match self {
            Self::OfficialSmoke => Some(name.to_owned()),
            Self::Mmdet3d => canonical_from_mmdet3d(name),
            Self::ImagenetDla34 => canonical_from_imagenet(name, norms),
            Self::MobilenetV2 => return mobilenet_v2::canonical_name(name),
            Self::MobilenetV2InRows => return mobilenet_v2::canonical_name(&mobilenet_v2::modern_name(name)?),
            Self::MobilenetV2Tensorflow => {
                return mobilenet_v2::canonical_name(&mobilenet_v2::name_from_tensorflow(name)?);
            }
            Self::EfficientnetLite => return efficientnet_lite::canonical_name(name),
        }
        .filter(|name| is_canonical(name))
    }
}

fn canonical_from_mmdet3d(name: &str) -> Option<String> {
    let (part, rest) = name.split_once('.')?;
    match part {
        "backbone" => Some(format!("{BASE}{rest}")),
        "bbox_head" => Some(format!("heads.predictor.{}", renamed_module(rest, &HEADS)?)),
        "neck" => {
            let (stage, list, rest) = ["projs", "nodes", "ups"].iter().find_map(|list| {
                let (stage, rest) = rest.split_once(&format!(".{list}."))?;
                Some((stage, list.strip_suffix('s')?, rest))
            })?;
            let (index, tensor) = rest.split_once('.')?;
            let number = index.parse::<usize>().ok()?.checked_add(1)?;
            let tensor = if list == "up" { tensor.to_owned() } else { renamed_module(tensor, &UNITS)? };
            Some(format!("backbone.body.{stage}.{list}_{number}.{tensor}"))
        }
        _ => None,
    }
}

/// `module.tensor` with the module renamed by the first row that matches all of it.
fn renamed_module(name: &str, rows: &[(&str, &str)]) -> Option<String> {
    let (module, tensor) = name.rsplit_once('.')?;
    let (_, canonical) = rows.iter().find(|(theirs, _)| *theirs == module)?;
    Some(format!("{canonical}.{tensor}"))
}

/// ImageNet's running statistics stay behind: our backbone's norms start as group norms, or see the statistics of their
/// own data.
fn canonical_from_imagenet(name: &str, norms: ImagenetNorms) -> Option<String> {
    let (module, tensor) = name.rsplit_once('.')?;
    let (parent, norm) = module.rsplit_once('.').unwrap_or(("", module));
    let renamed = match norm {
        "bn1" | "bn2" | "bn" if norms == ImagenetNorms::AsOfficial => return None,
        "bn1" => "norm1",
        "bn2" => "norm2",
        "bn" => "norm",
        same => same,
    };
    matches!(tensor, "weight" | "bias").then(|| format!("{BASE}{parent}.{renamed}.{tensor}"))
}

/// Whether `name` is a parameter of the network or a running statistic of one of its norms.
fn is_canonical(name: &str) -> bool {
    let Some((module, tensor)) = name.rsplit_once('.') else { return false };
    let modules = &*SMOKE;
    match tensor {
        "weight" => [&modules.norms, &modules.convolutions, &modules.biased].iter().any(|set| set.contains(module)),
        "bias" => modules.norms.contains(module) || modules.biased.contains(module),
        "running_mean" | "running_var" => modules.norms.contains(module),
        _ => false,
    }
}

/// The 233 parameters of SMOKE on DLA-34 by their canonical names, sorted.
pub fn canonical_names() -> Vec<String> {
    let modules = &*SMOKE;
    let weights = modules.norms.iter().chain(&modules.convolutions).chain(&modules.biased);
    let biases = modules.norms.iter().chain(&modules.biased);
    let mut names: Vec<String> = weights.map(|module| format!("{module}.weight")).collect();
    names.extend(biases.map(|module| format!("{module}.bias")));
    names.sort();
    names
}

/// The running statistics that a batch-norm build has beside [`canonical_names`], sorted.
pub fn running_statistics() -> Vec<String> {
    SMOKE
        .norms
        .iter()
        .flat_map(|norm| ["running_mean", "running_var"].map(|tensor| format!("{norm}.{tensor}")))
        .collect()
}

/// Whether a tensor is in every checkpoint but in no forward pass: the outer projections of levels 3 and 4 (spec
/// section 2.3).
pub fn is_dead(name: &str) -> bool {
    name.strip_prefix(BASE)
        .is_some_and(|rest| rest.starts_with("level3.project.") || rest.starts_with("level4.project."))
}

static SMOKE: LazyLock<Modules> = LazyLock::new(Modules::of_smoke);

/// The modules of the network that own tensors.
struct Modules {
    /// Convolutions without a bias.
    convolutions: BTreeSet<String>,
    /// Convolutions with a bias.
    biased: BTreeSet<String>,
    norms: BTreeSet<String>,
}

impl Modules {
    fn of_smoke() -> Self {
        let mut modules = Self { convolutions: BTreeSet::new(), biased: BTreeSet::new(), norms: BTreeSet::new() };
        modules.add_base();
        for (stage, merges) in [("dla_up.ida_0", 1), ("dla_up.ida_1", 2), ("dla_up.ida_2", 3), ("ida_up", 2)] {
            modules.add_ida(stage, merges);
        }
        for head in ["class_head", "regression_head"] {
            modules.norms.insert(format!("heads.predictor.{head}.1"));
            modules.biased.extend(["0", "3"].map(|index| format!("heads.predictor.{head}.{index}")));
        }
        modules
    }

    /// DLA-34 (spec section 2): three single convolutions, then trees of depth 1, 2, 2, 1.
    fn add_base(&mut self) {
        for stem in ["base_layer", "level0", "level1"] {
            self.add_pair(&format!("{BASE}{stem}"), "0", "1");
        }
        for (tree, projects) in [
            ("level2", true),
            ("level3.tree1", true),
            ("level3.tree2", false),
            ("level4.tree1", true),
            ("level4.tree2", false),
            ("level5", true),
        ] {
            self.add_tree(&format!("{BASE}{tree}"));
            if projects {
                self.add_pair(&format!("{BASE}{tree}.project"), "0", "1");
            }
        }
        for outer in ["level3", "level4"] {
            self.add_pair(&format!("{BASE}{outer}.project"), "0", "1");
        }
    }

    /// Two blocks and the root that joins them.
    fn add_tree(&mut self, tree: &str) {
        for block in ["tree1", "tree2"] {
            self.add_pair(&format!("{tree}.{block}"), "conv1", "norm1");
            self.add_pair(&format!("{tree}.{block}"), "conv2", "norm2");
        }
        self.add_pair(&format!("{tree}.root"), "conv", "norm");
    }

    fn add_pair(&mut self, parent: &str, convolution: &str, norm: &str) {
        self.convolutions.insert(format!("{parent}.{convolution}"));
        self.norms.insert(format!("{parent}.{norm}"));
    }

    /// The merges of one iterative aggregation (spec section 3.2).
    fn add_ida(&mut self, stage: &str, merges: usize) {
        for number in 1..=merges {
            self.convolutions.insert(format!("backbone.body.{stage}.up_{number}"));
            for unit in ["proj", "node"] {
                let unit = format!("backbone.body.{stage}.{unit}_{number}");
                self.norms.insert(format!("{unit}.norm"));
                self.biased.extend(["", ".conv_offset_mask"].map(|tail| format!("{unit}.deform_conv{tail}")));
            }
        }
    }
}
