//! A windowless OpenGL context on a chosen device.

use std::ffi::{c_char, c_int, c_uint, c_void};
use std::num::NonZero;
use std::sync::Once;

use glutin::api::egl::context::PossiblyCurrentContext;
use glutin::api::egl::device::Device;
use glutin::api::egl::display::Display;
use glutin::api::egl::surface::Surface;
use glutin::config::{ConfigSurfaceTypes, ConfigTemplateBuilder};
use glutin::context::{ContextApi, ContextAttributesBuilder, GlProfile, Version};
use glutin::display::GetGlDisplay;
use glutin::prelude::{GlDisplay, NotCurrentGlContext, PossiblyCurrentGlContext};
use glutin::surface::{PbufferSurface, SurfaceAttributesBuilder};
use libloading::Library;

use super::RenderDevice;
use crate::Error;

/// Environment variable with the EGL device index, as in MuJoCo.
const VARIABLE: &str = "MUJOCO_EGL_DEVICE_ID";

/// Set after the first warning, because every evaluation opens a context.
static WARNED: Once = Once::new();

/// An OpenGL context with its surface.
pub(super) struct Context {
    context: PossiblyCurrentContext,
    surface: Surface<PbufferSurface>,
    device: usize,
}

impl Context {
    /// Opens a context and makes it current on this thread.
    ///
    /// # Errors
    /// [`Error::Graphics`] or [`Error::RenderDevice`] if no context can be opened.
    pub(super) fn open(device: RenderDevice) -> Result<Self, Error> {
        let devices: Vec<Device> = Device::query_devices().map_err(failed)?.collect();
        let mut reasons = Vec::new();
        for index in candidates(device, &devices)? {
            match Self::on(&devices[index]) {
                Ok((context, surface)) => {
                    if !reasons.is_empty() {
                        WARNED.call_once(|| {
                            tracing::warn!("passed over for drawing: {}", reasons.join("; "));
                        });
                    }
                    return Ok(Self { context, surface, device: index });
                }
                Err(error) => reasons.push(format!("device {index}: {error}")),
            }
        }
        let nothing = "EGL knows no device".to_owned();
        let reason = if reasons.is_empty() { nothing } else { reasons.join("; ") };
        Err(Error::Graphics { reason })
    }

    #[allow(unsafe_code)]
    fn on(
        device: &Device,
    ) -> glutin::error::Result<(PossiblyCurrentContext, Surface<PbufferSurface>)> {
        // SAFETY: the device is one that EGL listed, and EGL stays loaded.
        let display = unsafe { Display::with_device(device, None)? };
        let template = ConfigTemplateBuilder::new()
            .with_surface_type(ConfigSurfaceTypes::PBUFFER)
            .with_alpha_size(0)
            .with_depth_size(24)
            .with_stencil_size(8)
            .build();
        // SAFETY: the template asks for documented attributes of a display that is open.
        let config = unsafe { display.find_configs(template)? }.next();
        let nothing =
            glutin::error::ErrorKind::NotSupported("it offers no off-screen configuration");
        let config = config.ok_or(nothing)?;
        let attributes = ContextAttributesBuilder::new()
            .with_profile(GlProfile::Compatibility)
            .with_context_api(ContextApi::OpenGl(Some(Version::new(2, 0))))
            .build(None);
        // SAFETY: display and configuration belong together and are open.
        let context = unsafe { display.create_context(&config, &attributes)? };
        // MuJoCo renders to its own buffer. The surface only serves to make the context current.
        let attributes = SurfaceAttributesBuilder::<PbufferSurface>::new()
            .build(NonZero::<u32>::MIN, NonZero::<u32>::MIN);
        // SAFETY: as above.
        let surface = unsafe { display.create_pbuffer_surface(&config, &attributes)? };
        Ok((context.make_current(&surface)?, surface))
    }

    /// Makes this context current on this thread.
    pub(super) fn make_current(&self) -> Result<(), Error> {
        self.context.make_current(&self.surface).map_err(failed)
    }

    /// Maximal rows or columns of a frame, if the driver reports them. The context must be current.
    #[allow(unsafe_code)]
    pub(super) fn largest_side(&self) -> Option<usize> {
        const MAX_RENDERBUFFER_SIZE: c_uint = 0x84E8;
        type GetIntegers = unsafe extern "system" fn(c_uint, *mut c_int);

        let address = self.context.display().get_proc_address(c"glGetIntegerv");
        if address.is_null() {
            return None;
        }
        let mut side: c_int = 0;
        // SAFETY: the signature is OpenGL's, this thread has a current context, and the value asked for is one number.
        unsafe {
            let get = std::mem::transmute::<*const c_void, GetIntegers>(address);
            get(MAX_RENDERBUFFER_SIZE, &mut side);
        }
        usize::try_from(side).ok().filter(|&side| side > 0)
    }

    /// The index of its device.
    pub(super) fn device(&self) -> usize {
        self.device
    }
}

pub(super) fn failed(error: glutin::error::Error) -> Error {
    Error::Graphics { reason: error.to_string() }
}

/// The indices of the devices to try, in order.
fn candidates(device: RenderDevice, devices: &[Device]) -> Result<Vec<usize>, Error> {
    let (number, name) = match (device, std::env::var(VARIABLE)) {
        (RenderDevice::Number(number), _) => (number, "--render-device"),
        (RenderDevice::Auto { .. }, Ok(text)) => {
            let number = text.trim().parse().map_err(|_| Error::RenderDevice {
                asked: format!("{VARIABLE}={text}"),
                expected: "a number of a device".to_owned(),
            })?;
            (number, VARIABLE)
        }
        (RenderDevice::Auto { cuda }, Err(_)) => {
            let is_twin = |device| cuda.is_some() && cuda_ordinal(device) == cuda;
            let mut all: Vec<usize> = (0..devices.len()).collect();
            if let Some(twin) = devices.iter().position(is_twin) {
                all.swap(0, twin);
            }
            return Ok(all);
        }
    };
    if number < devices.len() {
        return Ok(vec![number]);
    }
    Err(Error::RenderDevice {
        asked: format!("{name} {number}"),
        expected: match devices.len() {
            0 => "this machine has no EGL device".to_owned(),
            count => format!("this machine has EGL devices 0 to {}", count - 1),
        },
    })
}

/// Descriptions of all EGL devices, ordered by index.
pub fn devices() -> Result<Vec<String>, Error> {
    Ok(Device::query_devices().map_err(failed)?.map(|device| describe(&device)).collect())
}

fn describe(device: &Device) -> String {
    let name = match device.drm_device_node_path() {
        Some(path) => path.display().to_string(),
        None if device.extensions().contains("EGL_MESA_device_software") => "software".to_owned(),
        None => device.name().unwrap_or("unnamed").to_owned(),
    };
    match cuda_ordinal(device) {
        Some(ordinal) => format!("{name} (cuda:{ordinal})"),
        None => name,
    }
}

/// The index of the device's CUDA device, if it has one (EGL_NV_device_cuda).
#[allow(unsafe_code)]
fn cuda_ordinal(device: &Device) -> Option<usize> {
    const CUDA_DEVICE: c_int = 0x323A;
    type GetProcAddress = unsafe extern "C" fn(*const c_char) -> *const ();
    type QueryAttribute = unsafe extern "C" fn(*const c_void, c_int, *mut isize) -> c_uint;

    if !device.extensions().contains("EGL_NV_device_cuda") {
        return None;
    }
    let mut ordinal = 0isize;
    // SAFETY: libEGL is loaded (it listed the device); the signatures are those of EGL 1.5 and of
    // EGL_EXT_device_query, and the device is valid for as long as the library is loaded.
    let found = unsafe {
        let egl = Library::new("libEGL.so.1").ok()?;
        let get_address = egl.get::<GetProcAddress>(b"eglGetProcAddress\0").ok()?;
        let address = get_address(c"eglQueryDeviceAttribEXT".as_ptr());
        if address.is_null() {
            return None;
        }
        let query = std::mem::transmute::<*const (), QueryAttribute>(address);
        query(device.raw_device().cast(), CUDA_DEVICE, &mut ordinal)
    };
    (found == 1).then(|| usize::try_from(ordinal).ok())?
}
