//! What a detector must know of its model.

use farsight_core::Codec;
use farsight_core::codec::STRIDE;
use farsight_core::detection::DecodeOptions;
use farsight_core::input::InputRules;
use farsight_net::config::{ModelConfig, Quirks, SIZE_STEP};

/// Facts about a model, and what to keep of its answers.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorSpec {
    /// Size and conventions of the network's input.
    pub input: InputRules,
    /// Decodes its head maps.
    pub codec: Codec,
    /// Habits that the model was trained with.
    pub quirks: Quirks,
    /// What to keep.
    pub options: DecodeOptions,
}

impl DetectorSpec {
    /// The facts of `config`.
    pub fn new(config: &ModelConfig, options: DecodeOptions) -> Self {
        Self { input: config.input_rules(), codec: config.codec(), quirks: config.quirks, options }
    }

    /// The input for an image of `image_size` (width and height, pixels).
    ///
    /// The width is the model's. So is the height, the image centred and cropped or padded, as SMOKE does, as long as that loses at most 16 rows at the
    /// top and at the bottom: images of KITTI's shape. A higher image gets an input as high as it needs, in steps of 32, because the network is
    /// fully convolutional; at most as high as wide, as beyond that the time grows and a road fills no picture. A portrait image is cropped to that square.
    pub fn input_for(&self, image_size: [usize; 2]) -> InputRules {
        let [width, height] = self.input.size;
        let scaled_height = image_size[1] as f64 * width as f64 / image_size[0].max(1) as f64;
        if scaled_height <= (height + SIZE_STEP) as f64 {
            return self.input;
        }
        let whole = (scaled_height / SIZE_STEP as f64).ceil().min((width / SIZE_STEP) as f64) as usize * SIZE_STEP;
        InputRules { size: [width, whole.max(height)], ..self.input }
    }

    /// Width and height, cells, of the head maps for an input of `input_size`.
    pub(crate) fn map_size(input_size: [usize; 2]) -> [usize; 2] {
        input_size.map(|side| side / STRIDE)
    }
}

#[cfg(test)]
mod tests {
    use farsight_core::detection::DecodeOptions;
    use farsight_net::config::ModelConfig;

    use super::DetectorSpec;

    #[test]
    fn input_sizes() {
        let spec = DetectorSpec::new(&ModelConfig::default(), DecodeOptions::default());
        let table = [
            ("KITTI", [1242, 375], [1280, 384]),
            ("KITTI, the smallest", [1224, 370], [1280, 384]),
            ("full HD", [1920, 1080], [1280, 736]),
            ("4:3", [640, 480], [1280, 960]),
            ("a panorama", [4000, 500], [1280, 384]),
            ("32 rows too high", [1280, 416], [1280, 384]),
            ("33 rows too high", [1280, 417], [1280, 448]),
            ("a square", [1, 1], [1280, 1280]),
            ("portrait", [1080, 1920], [1280, 1280]),
        ];
        for (name, image_size, expected) in table {
            assert_eq!(spec.input_for(image_size).size, expected, "{name}");
        }
    }
}
