//! A copy of the stand-in library, which is a world of its own, loaded as the vendor's is.

use std::path::PathBuf;
use std::sync::MutexGuard;

use kerf_stand_in_hd::{Control, Device, World};
use kerf_station::config::OpenHapticsConfig;

pub struct StandIn {
    pub file: PathBuf,
    control: &'static Control,
    _folder: tempfile::TempDir,
}

impl StandIn {
    #[allow(unsafe_code, reason = "the stand-in is a library that is loaded at run time")]
    pub fn new(devices: &[Device]) -> Self {
        let name = format!("{}kerf_stand_in_hd{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
        let built = std::env::current_exe().unwrap().with_file_name(&name);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(name);
        std::fs::copy(&built, &file).unwrap_or_else(|error| panic!("{}: {error}", built.display()));
        // SAFETY: the symbol has this type; the library is never unloaded.
        let control = unsafe {
            let library = libloading::Library::new(&file).unwrap();
            let control = library.get::<extern "system" fn() -> &'static Control>("standInControl").unwrap()();
            std::mem::forget(library);
            control
        };
        control.world().devices = devices.to_vec();
        Self { file, control, _folder: folder }
    }

    pub fn world(&self) -> MutexGuard<'static, World> {
        self.control.world()
    }

    pub fn config(&self, name: Option<&str>) -> OpenHapticsConfig {
        OpenHapticsConfig { library: Some(self.file.clone()), name: name.map(Into::into) }
    }
}
