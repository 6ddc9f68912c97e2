//! Description of the renderer.

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::fmt;

use libloading::Library;

use super::RenderDevice;
use super::context::Context;
use crate::Error;
use crate::dmc::redirect_messages;

/// The renderer, as reported by OpenGL and EGL. Only equal renderers produce identical frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RendererDescription {
    /// EGL device index.
    pub device: usize,
    /// OpenGL's vendor, renderer and version.
    pub software: String,
    /// EGL's vendor and version.
    pub egl: String,
}

impl RendererDescription {
    /// Whether the renderer runs on the CPU.
    pub fn is_on_cpu(&self) -> bool {
        ["llvmpipe", "softpipe", "swrast"].iter().any(|name| self.software.contains(name))
    }
}

impl fmt::Display for RendererDescription {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} (EGL device {})", self.software, self.device)
    }
}

/// Describes the renderer on a device.
///
/// # Errors
/// [`Error::Graphics`] if rendering fails, [`Error::RenderDevice`] for a device that does not exist.
pub fn renderer_description(device: RenderDevice) -> Result<RendererDescription, Error> {
    redirect_messages();
    let graphics = Context::open(device)?;
    let egl = load_egl()?;
    Ok(RendererDescription {
        device: graphics.device(),
        software: gl_names(&egl)?,
        egl: egl_names(&egl)?,
    })
}

/// Opens another handle of the EGL library that the current context has loaded.
#[allow(unsafe_code)]
fn load_egl() -> Result<Library, Error> {
    // SAFETY: the library is loaded already (a context of it is current), so nothing of it runs now.
    unsafe { Library::new("libEGL.so.1") }.map_err(failed)
}

/// EGL vendor and version of the current context's display.
#[allow(unsafe_code)]
fn egl_names(egl: &Library) -> Result<String, Error> {
    const VENDOR: c_int = 0x3053;
    const VERSION: c_int = 0x3054;
    type GetCurrentDisplay = unsafe extern "C" fn() -> *const c_void;
    type QueryString = unsafe extern "C" fn(*const c_void, c_int) -> *const c_char;

    // SAFETY: the signatures are those of EGL 1.5, and `egl` outlives the calls below.
    let (display, query) = unsafe {
        let display = egl.get::<GetCurrentDisplay>(b"eglGetCurrentDisplay\0").map_err(failed)?;
        (display(), egl.get::<QueryString>(b"eglQueryString\0").map_err(failed)?)
    };
    let name = |which| {
        // SAFETY: EGL answers with a static, terminated string, or null where it does not know the display.
        text(unsafe { query(display, which) })
    };
    Ok(format!("{}, {}", name(VENDOR), name(VERSION)))
}

/// OpenGL vendor, renderer and version of the current context.
#[allow(unsafe_code)]
fn gl_names(egl: &Library) -> Result<String, Error> {
    const VENDOR: c_uint = 0x1F00;
    const RENDERER: c_uint = 0x1F01;
    const VERSION: c_uint = 0x1F02;
    type GetProcAddress = unsafe extern "C" fn(*const c_char) -> *const ();
    type GetString = unsafe extern "C" fn(c_uint) -> *const c_char;

    // SAFETY: the signature is the one that EGL 1.5 gives for eglGetProcAddress, and `egl` outlives the calls below.
    let get_string: GetString = unsafe {
        let get_address = egl.get::<GetProcAddress>(b"eglGetProcAddress\0").map_err(failed)?;
        let address = get_address(c"glGetString".as_ptr());
        if address.is_null() {
            return Err(failed("EGL knows no glGetString"));
        }
        std::mem::transmute::<*const (), GetString>(address)
    };
    let name = |which| {
        // SAFETY: a context is current on this thread, so glGetString answers with a static,
        // terminated string, or null for a name it does not know.
        text(unsafe { get_string(which) })
    };
    Ok(format!("{}, {}, {}", name(VENDOR), name(RENDERER), name(VERSION)))
}

/// Converts a driver's string.
#[allow(unsafe_code)]
fn text(answer: *const c_char) -> String {
    if answer.is_null() {
        return "unknown".to_owned();
    }
    // SAFETY: not null, and a driver's strings are terminated and static.
    unsafe { CStr::from_ptr(answer) }.to_string_lossy().into_owned()
}

fn failed(reason: impl ToString) -> Error {
    Error::Graphics { reason: reason.to_string() }
}
