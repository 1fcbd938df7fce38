//! Left and right change places: how people drive on the left.

use farsight_core::Camera;

use crate::scene::LabelledScene;

/// Mirrors a scene left to right, its camera and labels too.
///
/// Traffic that keeps right then keeps left, drivers sit on the right, and shadows fall as they would.
pub(crate) fn mirror(generated: &mut LabelledScene) {
    let LabelledScene { scene, objects } = generated;
    scene.camera = Camera::mirrored(&scene.camera, scene.image_size[0]);
    for vertex in scene.objects.iter_mut().flat_map(|object| &mut object.mesh.vertices) {
        vertex.position[0] = -vertex.position[0];
        vertex.normal[0] = -vertex.normal[0];
    }
    scene.sun.direction[0] = -scene.sun.direction[0];
    // The photograph itself is not mirrored: its sun moves to where the scene's is.
    if let Some(photograph) = &mut scene.sky.photograph {
        photograph.towards_sun[0] = -photograph.towards_sun[0];
    }
    for lamp in &mut scene.lamps {
        lamp.position[0] = -lamp.position[0];
        lamp.direction[0] = -lamp.direction[0];
    }
    for labelled in objects {
        labelled.box3d = labelled.box3d.mirrored();
    }
}
