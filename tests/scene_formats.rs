//! A scene means the same in TOML, in JSON and in code, and is written so that it reads back to the bit.

use sprung::scene::{Kind, Scene, builtin};

#[test]
fn every_builtin_scene_reads_back_to_the_bit() {
    for kind in Kind::ALL {
        for size in [1, 2, 3, kind.default_size()] {
            let scene = builtin(kind, size).unwrap();
            scene.build().unwrap();
            assert_eq!(Scene::from_toml(&scene.to_toml()).unwrap(), scene);
            assert_eq!(Scene::from_json(&scene.to_json()).unwrap(), scene);
        }
    }
}
