//! The laws of data sets, for each kind of them.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use farsight_core::{Camera, Label, ObjectClass, Pose};
use farsight_data::annotations::{DepthMap, Plate, Plates};
use farsight_data::dataset::{FolderCamera, ImageFolderError, check_laws};
use farsight_data::formats::FORMATS;
use farsight_data::kitti::{Calibration, RowKind, rows::rows_from_text};
use farsight_data::{
    CachedDataset, CorruptedDataset, Corruption, Dataset, DatasetError, Frame, ImageFolder, KittiDataset,
    MemoryDataset, open_dataset,
};
use image::{Rgb, RgbImage};

const CAR: &str = "Car 0.00 0 1.50 600.00 170.00 700.00 230.00 1.50 1.60 4.00 1.00 1.70 20.00 1.60";

fn image(number: u8) -> RgbImage {
    RgbImage::from_fn(12, 5, |x, y| Rgb([number, x as u8, y as u8]))
}

fn camera(number: u8) -> Camera {
    Camera::from_intrinsics(700.0 + f64::from(number), 700.0, 6.0, 2.0).unwrap()
}

fn labels(text: &str) -> Vec<Label> {
    rows_from_text(text, Path::new("labels"), RowKind::Label).unwrap().into_iter().map(|row| row.label).collect()
}

fn plates(number: u8) -> Plates {
    Plates((0..usize::from(number)).map(|label| Plate { label, ends: [[1.0, 1.5, 9.0], [0.5, 1.5, 9.25]] }).collect())
}

fn in_memory() -> MemoryDataset {
    let frames = (0..3).map(|number| {
        let frame =
            Frame::new(format!("{number:06}"), image(number), camera(number), labels(&format!("{CAR}\n").repeat(2)));
        let pose = Pose { translation_m: [0.0, 0.0, f64::from(number)], ..Pose::IDENTITY };
        Frame { timestamp_ns: Some(i64::from(number) * 100), world_from_camera: Some(pose), ..frame }
            .with(plates(number))
            .with(DepthMap { depth_m: vec![f32::from(number); 60] })
    });
    MemoryDataset::new("memory", frames)
}

/// Writes a data set in KITTI's layout.
fn write_kitti(root: &Path, dataset: &dyn Dataset, annotation_folder: bool) {
    for name in ["image_2", "calib", "label_2"].into_iter().chain(annotation_folder.then_some("plates")) {
        fs::create_dir_all(root.join("training").join(name)).unwrap();
    }
    for index in 0..dataset.len() {
        let frame = dataset.frame(index).unwrap();
        let path = |folder: &str, extension: &str| root.join(format!("training/{folder}/{}.{extension}", frame.id));
        frame.image.save(path("image_2", "png")).unwrap();
        Calibration::from_camera(&frame.camera).write(&path("calib", "txt")).unwrap();
        farsight_data::kitti::write_labels(&path("label_2", "txt"), &frame.labels).unwrap();
        if annotation_folder {
            for format in farsight_data::annotations::FILE_FORMATS {
                format.write(&root.join("training"), &frame.id, &frame.annotations).unwrap();
            }
        }
    }
}

fn assert_lawful(dataset: &Arc<dyn Dataset>) {
    let name = dataset.name();
    assert_eq!(check_laws(dataset, usize::MAX).unwrap(), None, "{name}");
}

#[test]
fn frames_in_memory() {
    let dataset: Arc<dyn Dataset> = Arc::new(in_memory());
    assert!(dataset.has::<Plates>() && dataset.has::<DepthMap>());
    assert_eq!(dataset.frame(2).unwrap().annotation::<Plates>(), Some(&plates(2)));
    assert_lawful(&dataset);
    let some_with_depth = [Frame::new("a", image(0), camera(0), vec![]), (*in_memory().frame(0).unwrap()).clone()];
    let mixed: Arc<dyn Dataset> = Arc::new(MemoryDataset::new("mixed", some_with_depth));
    assert!(!mixed.has::<Plates>(), "not every frame has them");
    assert_lawful(&mixed);
    assert_lawful(&(Arc::new(MemoryDataset::new("empty", [])) as Arc<dyn Dataset>));
}

#[test]
fn broken_laws_are_found() {
    let twice = [0, 0].map(|number| Frame::new("a", image(number), camera(number), vec![]));
    let broken: Arc<dyn Dataset> = Arc::new(MemoryDataset::new("twice", twice));
    assert!(check_laws(&broken, 9).unwrap().unwrap().contains("names are not one for each of 2 frames"));
    let broken: Arc<dyn Dataset> = Arc::new(in_memory().unlabelled());
    assert_eq!(check_laws(&broken, 9).unwrap().unwrap(), "frame 0: labels of what is not labelled");
}

#[test]
fn a_folder_in_kittis_layout() {
    let folder = tempfile::tempdir().unwrap();
    write_kitti(folder.path(), &in_memory(), true);
    let dataset = open_dataset(folder.path(), None).unwrap();
    assert_eq!((dataset.len(), dataset.annotation_names()), (3, vec!["plates"]));
    let (read, made) = (dataset.frame(2).unwrap(), in_memory().frame(2).unwrap());
    assert_eq!((&read.id, &read.image, &read.labels), (&made.id, &made.image, &made.labels));
    assert_eq!(read.annotation::<Plates>(), Some(&plates(2)));
    assert_eq!(dataset.label_folder(), Some(folder.path().join("training/label_2")));
    assert!(dataset.origin(1).ends_with("000001.png"), "{}", dataset.origin(1));
    assert_lawful(&dataset);
    // A frame may lack its file; a data set without the folder knows nothing of plates.
    fs::remove_file(folder.path().join("training/plates/000002.txt")).unwrap();
    let dataset = open_dataset(folder.path(), None).unwrap();
    assert_eq!(dataset.frame(2).unwrap().annotation::<Plates>(), Some(&Plates::default()));
    fs::remove_dir_all(folder.path().join("training/plates")).unwrap();
    let dataset = open_dataset(folder.path(), None).unwrap();
    assert!(!dataset.has::<Plates>() && dataset.frame(2).unwrap().annotation::<Plates>().is_none());
    assert_lawful(&dataset);
}

#[test]
fn cameras_and_labels_are_read_without_the_pixels() {
    let folder = tempfile::tempdir().unwrap();
    write_kitti(folder.path(), &in_memory(), false);
    let dataset = KittiDataset::open(folder.path(), None).unwrap();
    let broken = folder.path().join("training/image_2/000001.png");
    fs::write(&broken, "no image").unwrap();
    assert_eq!(dataset.labels(1).unwrap().len(), 2);
    assert_eq!(dataset.camera(1).unwrap(), dataset.frame(0).map(|_| camera(1)).unwrap());
    let told = dataset.frame(1).unwrap_err().to_string();
    assert!(told.starts_with(&broken.display().to_string()), "{told}");
    // What failed once is not kept: the file may come back.
    let cached = CachedDataset::new(Arc::new(dataset));
    assert!(cached.frame(1).is_err());
    image(9).save(&broken).unwrap();
    assert_eq!(cached.image(1).unwrap(), image(9));
    // What was read is kept: the file may go.
    fs::remove_file(&broken).unwrap();
    assert_eq!(cached.frame(1).unwrap().image, image(9));
}

#[test]
fn a_corruption_changes_the_pixels_and_nothing_else() {
    let below: Arc<dyn Dataset> = Arc::new(in_memory());
    let noisy: Arc<dyn Dataset> = Arc::new(CorruptedDataset::new(Arc::clone(&below), Corruption::GaussianNoise, 3));
    assert_eq!(check_laws(&noisy, 3).unwrap(), None);
    let (found, plain) = (noisy.frame(2).unwrap(), below.frame(2).unwrap());
    assert_ne!(found.image, plain.image);
    assert_eq!(Frame { image: plain.image.clone(), ..Frame::clone(&found) }, *plain);
}

#[test]
fn class_names_of_a_folder_are_mapped() {
    let folder = tempfile::tempdir().unwrap();
    write_kitti(folder.path(), &in_memory(), false);
    let text = format!("{}\n{}\n{CAR}\n", CAR.replace("Car", "Bus"), CAR.replace("Car", "Cone"));
    fs::write(folder.path().join("training/label_2/000001.txt"), text).unwrap();
    let classes = |index: usize| -> Vec<ObjectClass> {
        let dataset = open_dataset(folder.path(), None).unwrap();
        dataset.labels(index).unwrap().into_iter().map(|label| label.class).collect()
    };
    assert_eq!(classes(1)[0], ObjectClass::Other("Bus".into()));
    fs::write(folder.path().join("classes.txt"), "Bus Truck\nCone DontCare\n").unwrap();
    assert_eq!(classes(1), [ObjectClass::Truck, ObjectClass::DontCare, ObjectClass::Car]);
    assert_eq!(classes(0), [ObjectClass::Car, ObjectClass::Car]);
    let dataset = open_dataset(folder.path(), None).unwrap();
    assert_eq!(dataset.label_folder(), None, "the files say something else than the labels");
    assert_lawful(&dataset);
    fs::write(folder.path().join("classes.txt"), "Bus\n").unwrap();
    let told = open_dataset(folder.path(), None).unwrap_err().to_string();
    assert!(told.contains("classes.txt:1: \"Bus\"; expected a class name"), "{told}");
}

#[test]
fn a_folder_of_images() {
    let folder = tempfile::tempdir().unwrap();
    let open = |camera| ImageFolder::open(folder.path(), camera);
    let told = |result: Result<ImageFolder, ImageFolderError>| result.unwrap_err().to_string();
    assert!(told(open(FolderCamera::Fixed(camera(0)))).ends_with("no images; expected files such as 000000.png"));
    for (number, name) in ["b.png", "a.jpg", "c.PNG"].into_iter().enumerate() {
        image(number as u8).save(folder.path().join(name)).unwrap();
    }
    fs::write(folder.path().join("notes.txt"), "").unwrap();
    let dataset = open(FolderCamera::HorizontalFov(60.0)).unwrap();
    assert_eq!(dataset.ids(), ["a", "b", "c"]);
    assert_eq!(dataset.camera(1).unwrap(), Camera::from_hfov(60.0, 12, 5).unwrap());
    assert_eq!(open(FolderCamera::Fixed(camera(7))).unwrap().camera(2).unwrap(), camera(7));
    assert!(dataset.label_folder().is_none() && !dataset.is_labelled());
    assert_lawful(&(Arc::new(dataset) as Arc<dyn Dataset>));
    let wrong = open(FolderCamera::HorizontalFov(190.0)).unwrap().frame(0).unwrap_err().to_string();
    assert!(wrong.contains("a.jpg: ") && wrong.contains("190"), "{wrong}");
    image(0).save(folder.path().join("b.jpg")).unwrap();
    assert!(told(open(FolderCamera::Fixed(camera(0)))).contains("b.png: there is another image of this name"));
    assert!(
        told(ImageFolder::open(&folder.path().join("none"), FolderCamera::Fixed(camera(0))))
            .contains("cannot be listed")
    );
}

#[test]
fn a_portrait_photograph_has_the_camera_of_the_upright_image() {
    use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new(&mut bytes);
    // A TIFF header and one entry: orientation 6, to be turned by a quarter.
    let exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    encoder.set_exif_metadata(exif.to_vec()).unwrap();
    encoder.write_image(image(0).as_raw(), 12, 5, ExtendedColorType::Rgb8).unwrap();
    fs::write(folder.path().join("portrait.jpg"), bytes).unwrap();
    let dataset = ImageFolder::open(folder.path(), FolderCamera::HorizontalFov(60.0)).unwrap();
    assert_eq!(dataset.image(0).unwrap().dimensions(), (5, 12));
    assert_eq!(dataset.camera(0).unwrap(), Camera::from_hfov(60.0, 5, 12).unwrap());
}

#[test]
fn a_folder_of_no_known_kind_is_told_with_what_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let error = open_dataset(folder.path(), None).unwrap_err();
    assert!(matches!(&error, DatasetError::UnknownFormat { known, .. } if known.len() == FORMATS.len()));
    let expected = "no data set that is known here; expected {image_2,calib,label_2} here or in training/";
    assert!(error.to_string().ends_with(expected), "{error}");
    // What begins like one is told what it lacks.
    fs::create_dir(folder.path().join("calib")).unwrap();
    let told = open_dataset(folder.path(), None).unwrap_err().to_string();
    assert!(told.contains("no folder \"image_2\""), "{told}");
}
