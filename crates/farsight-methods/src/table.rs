//! What becomes of the table of methods in `lib.rs`.

/// Makes a module of each folder that is named, and all tables of methods.
///
/// A line is the folder's name, the type of its config and, of a method that is trained here, its task in the module
/// `train`.
macro_rules! methods {
    (
        detectors { $($folder:ident: $config:ident $(, $task:ident)?;)+ }
        second_stages { $($stage:ident: $stage_config:ident, $stage_task:ident;)+ }
    ) => {
        $(pub mod $folder;)+
        $(pub mod $stage;)+

        /// Detectors, and what can be done with their files.
        const DETECTORS: &[detectors::Entry] = &[$(detectors::Entry::new::<$folder::$config>(),)+];

        /// All methods, and what they say of themselves.
        const METHODS: &[description::Entry] = &[
            $(description::Entry::new::<$folder::$config>(true, methods!(@is_there $($task)?)),)+
            $(description::Entry::new::<$stage::$stage_config>(false, true),)+
        ];

        /// What can be trained here.
        #[cfg(feature = "train")]
        const TASKS: &[training::Entry] = &[
            $($(training::Entry::new::<$folder::train::$task>(),)?)+
            $(training::Entry::new::<$stage::train::$stage_task>(),)+
        ];

        /// Shows `visitor` every method.
        pub fn each_method(visitor: &mut impl method::MethodVisitor) {
            $(visitor.visit::<$folder::$config>();)+
            $(visitor.visit::<$stage::$stage_config>();)+
        }

        /// Shows `visitor` every detector.
        pub fn each_detector(visitor: &mut impl method::DetectorVisitor) {
            $(visitor.visit::<$folder::$config>();)+
        }

        /// Shows `visitor` every task that can be trained.
        #[cfg(feature = "train")]
        pub fn each_task(visitor: &mut impl training::TaskVisitor) {
            $($(visitor.visit::<$folder::train::$task>();)?)+
            $(visitor.visit::<$stage::train::$stage_task>();)+
        }

        /// Gives `taker` the model whose weights, with method and config in their header, are in memory, if it is a
        /// detector; `source` is only what errors call it.
        ///
        /// # Errors
        /// When it is a detector and broken.
        pub fn with_detector<T: method::ModelTaker>(
            weights: farsight_graph::weights::Weights,
            source: &std::path::Path,
            taker: T,
        ) -> Result<Option<T::Answer>, farsight_graph::model::ModelError> {
            use farsight_graph::model::{Model, NetworkConfig};
            let tag = farsight_graph::model::method_of(&weights).to_owned();
            $(
                if tag == <$folder::$config as NetworkConfig>::METHOD {
                    return Ok(Some(taker.take(Model::<$folder::$config>::from_weights(weights, source)?)));
                }
            )+
            Ok(None)
        }
    };
    (@is_there) => { false };
    (@is_there $task:ident) => { true };
}
