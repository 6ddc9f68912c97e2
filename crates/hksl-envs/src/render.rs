//! Off-screen drawing through EGL, pixel for pixel as dm_control draws.

use std::ffi::{CStr, c_char, c_uint};

use libloading::Library;
use mujoco_rs::prelude::{MjData, MjModel, MjtFontScale, MjvCamera};
use mujoco_rs::renderer::{MjRenderer, RendererError};
use ndarray::{Array3, ArrayView3};

use crate::Error;
use crate::dmc::{Physics, redirect_messages};

/// The camera of every task's pictures.
const CAMERA: usize = 0;
/// Places for what is drawn beyond the model's own geoms (tendons); dm_control keeps 1000 in all.
const EXTRA_GEOMS: u32 = 1000;

/// Draws one simulation. It belongs to the thread that made it.
///
/// Everything that shapes the picture is MuJoCo's and the model's default, as in dm_control: four
/// samples a pixel, shadow map of the model's size, shadows and reflections on.
pub(crate) struct Renderer {
    inner: MjRenderer,
    height: usize,
    width: usize,
}

impl Renderer {
    /// A renderer of `height` × `width` pictures of this physics' model.
    pub(crate) fn new(physics: &mut Physics, height: usize, width: usize) -> Result<Self, Error> {
        let data = physics.data_mut();
        let (rows, columns) = (pixels(height)?, pixels(width)?);
        // MuJoCo draws into a buffer of this size and cuts what does not fit.
        let buffer = &mut data.model_vis_mut().global;
        buffer.offheight = buffer.offheight.max(rows);
        buffer.offwidth = buffer.offwidth.max(columns);
        let inner = MjRenderer::builder()
            .height(rows.unsigned_abs())
            .width(columns.unsigned_abs())
            .num_visual_internal_geom(EXTRA_GEOMS)
            .font_scale(MjtFontScale::mjFONTSCALE_150)
            .camera(MjvCamera::new_fixed(CAMERA))
            .build(data.model())
            .map_err(graphics)?;
        Ok(Self { inner, height, width })
    }

    /// The current state from camera 0: `(3, height, width)`.
    pub(crate) fn frame(&mut self, physics: &mut Physics) -> Result<Array3<u8>, Error> {
        self.inner.sync_data(physics.data_mut()).map_err(graphics)?;
        self.inner.render().map_err(graphics)?;
        let pixels = self.inner.rgb_flat().unwrap_or_default();
        let picture = ArrayView3::from_shape((self.height, self.width, 3), pixels)
            .map_err(|error| Error::Graphics { reason: error.to_string() })?;
        Ok(picture.permuted_axes([2, 0, 1]).as_standard_layout().into_owned())
    }
}

/// A picture's side as MuJoCo counts it.
fn pixels(side: usize) -> Result<i32, Error> {
    i32::try_from(side).map_err(|_| Error::Graphics {
        reason: format!("a picture {side} pixels high or wide is out of range"),
    })
}

fn graphics(error: RendererError) -> Error {
    let reason = match &error {
        RendererError::GlutinError(cause) => cause.to_string(),
        other => other.to_string(),
    };
    Error::Graphics { reason }
}

/// What draws here: vendor, renderer and version as OpenGL reports them. Pictures are equal to the
/// pixel only where these are.
///
/// # Errors
/// [`Error::Graphics`] where nothing can be drawn.
pub fn renderer_description() -> Result<String, Error> {
    redirect_messages();
    let model = MjModel::from_xml_string("<mujoco/>")
        .map_err(|error| Error::Graphics { reason: error.to_string() })?;
    let mut data =
        MjData::try_new(&model).map_err(|error| Error::Graphics { reason: error.to_string() })?;
    let mut renderer = MjRenderer::builder().height(1).width(1).build(&model).map_err(graphics)?;
    renderer.sync_data(&mut data).map_err(graphics)?;
    // Makes its context the current one, which `gl_strings` asks.
    renderer.render().map_err(graphics)?;
    gl_strings()
}

/// OpenGL's own names for what the current context draws with.
#[allow(unsafe_code)]
fn gl_strings() -> Result<String, Error> {
    const VENDOR: c_uint = 0x1F00;
    const RENDERER: c_uint = 0x1F01;
    const VERSION: c_uint = 0x1F02;
    type GetProcAddress = unsafe extern "C" fn(*const c_char) -> *const ();
    type GetString = unsafe extern "C" fn(c_uint) -> *const c_char;

    let failed = |reason: String| Error::Graphics { reason };
    // SAFETY: libEGL is loaded already (a context of it is current); the signature is the one that
    // EGL 1.5 gives for eglGetProcAddress, and the handle outlives the calls below.
    let get_string: GetString = unsafe {
        let egl = Library::new("libEGL.so.1").map_err(|error| failed(error.to_string()))?;
        let get_address = egl
            .get::<GetProcAddress>(b"eglGetProcAddress\0")
            .map_err(|error| failed(error.to_string()))?;
        let address = get_address(c"glGetString".as_ptr());
        if address.is_null() {
            return Err(failed("EGL knows no glGetString".to_owned()));
        }
        std::mem::transmute::<*const (), GetString>(address)
    };
    let name = |which| {
        // SAFETY: a context is current on this thread, so glGetString answers with a static,
        // terminated string, or null for a name it does not know.
        let text = unsafe { get_string(which) };
        if text.is_null() {
            return "unknown".to_owned();
        }
        // SAFETY: not null, terminated, and static as said above.
        unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
    };
    Ok(format!("{}, {}, {}", name(VENDOR), name(RENDERER), name(VERSION)))
}
