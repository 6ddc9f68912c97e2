//! Drawing one simulation with MuJoCo's own renderer.

use std::ffi::{CStr, c_char, c_uint};
use std::fmt;

use libloading::Library;
use mujoco_rs::prelude::{
    MjModel, MjrContext, MjrRectangle, MjtFontScale, MjtRndFlag, MjtVisFlag, MjvCamera, MjvOption,
    MjvPerturb, MjvScene,
};
use ndarray::{Array3, ArrayView3, s};

use super::context::Context;
use super::{RenderDevice, RenderSettings};
use crate::Error;
use crate::dmc::{Physics, redirect_messages};

/// The camera of every task's pictures.
pub(crate) const CAMERA: usize = 0;
/// Places for what is drawn beyond the model's own geoms (tendons); dm_control keeps 1000 in all.
const EXTRA_GEOMS: usize = 1000;

/// Draws one simulation. It belongs to the thread that made it.
///
/// But for the settings, everything that shapes the picture is MuJoCo's and the model's default, as in dm_control.
pub(crate) struct Renderer {
    scene: MjvScene,
    context: MjrContext,
    /// Outlives `context`, which it must be current for.
    graphics: Context,
    option: MjvOption,
    camera: MjvCamera,
    viewport: MjrRectangle,
    /// Rows from the bottom up.
    pixels: Vec<u8>,
    height: usize,
    width: usize,
}

impl Renderer {
    /// A renderer of `height` × `width` pictures of this physics' model.
    pub(crate) fn new(
        physics: &mut Physics,
        (height, width): (usize, usize),
        settings: RenderSettings,
        device: RenderDevice,
    ) -> Result<Self, Error> {
        let data = physics.data_mut();
        let (rows, columns) = (whole(height)?, whole(width)?);
        // MuJoCo draws into a buffer of this size and cuts what does not fit.
        let buffer = &mut data.model_vis_mut().global;
        buffer.offheight = buffer.offheight.max(rows);
        buffer.offwidth = buffer.offwidth.max(columns);
        let quality = &mut data.model_vis_mut().quality;
        quality.offsamples = whole(settings.samples)?;
        quality.shadowsize = whole(settings.shadow_map)?;
        let graphics = Context::open(device)?;
        let model = data.model();
        let context = new_context(&graphics, model)?;
        let geoms = model.geom_size().len() + EXTRA_GEOMS;
        let mut scene = MjvScene::new(model, geoms);
        for (flag, on) in [
            (MjtRndFlag::mjRND_SHADOW, settings.shadows),
            (MjtRndFlag::mjRND_REFLECTION, settings.reflections),
        ] {
            scene.flags_mut()[flag as usize] = u8::from(on);
        }
        let mut option = MjvOption::default();
        option.flags[MjtVisFlag::mjVIS_RANGEFINDER as usize] = 0;
        Ok(Self {
            scene,
            context,
            graphics,
            option,
            camera: MjvCamera::new_fixed(CAMERA),
            viewport: MjrRectangle::new(0, 0, columns, rows),
            pixels: vec![0; 3 * height * width],
            height,
            width,
        })
    }

    /// The current state from camera 0: `(3, height, width)`.
    pub(crate) fn frame(&mut self, physics: &mut Physics) -> Result<Array3<u8>, Error> {
        let failed = |reason: String| Error::Graphics { reason };
        self.graphics.make_current()?;
        let Self { scene, option, camera, context, viewport, pixels, .. } = self;
        scene.update(physics.data_mut(), option, &MjvPerturb::default(), camera);
        scene.render(viewport, context);
        context
            .read_pixels(Some(&mut pixels[..]), None, viewport)
            .map_err(|error| failed(error.to_string()))?;
        let picture = ArrayView3::from_shape((self.height, self.width, 3), &self.pixels)
            .map_err(|error| failed(error.to_string()))?;
        let upright = picture.slice_move(s![..;-1, .., ..]).permuted_axes([2, 0, 1]);
        Ok(upright.as_standard_layout().into_owned())
    }
}

impl Drop for Renderer {
    fn drop(&mut self) {
        // What MuJoCo keeps on the device is freed through the current context. Should that fail, nothing is lost
        // but the device's memory, until the process ends.
        if let Err(error) = self.graphics.make_current() {
            tracing::debug!("a renderer could not be freed: {error}");
        }
    }
}

#[allow(unsafe_code)]
fn new_context(graphics: &Context, model: &MjModel) -> Result<MjrContext, Error> {
    graphics.make_current()?;
    // SAFETY: a context is current on this thread, as just asked for.
    let mut context = unsafe { MjrContext::new(model) };
    context.offscreen();
    context.change_font(MjtFontScale::mjFONTSCALE_150);
    Ok(context)
}

/// A count of pixels as MuJoCo has it.
fn whole(count: usize) -> Result<i32, Error> {
    i32::try_from(count).map_err(|_| Error::Graphics {
        reason: format!("a picture {count} pixels high or wide is out of range"),
    })
}

/// What draws, as OpenGL reports it. Pictures are equal to the pixel only where these are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RendererDescription {
    /// The number of EGL's device.
    pub device: usize,
    /// Vendor, renderer and version.
    pub software: String,
}

impl fmt::Display for RendererDescription {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} (EGL device {})", self.software, self.device)
    }
}

/// What draws here.
///
/// # Errors
/// [`Error::Graphics`] where nothing can be drawn, [`Error::RenderDevice`] for a device that there is not.
pub fn renderer_description(device: RenderDevice) -> Result<RendererDescription, Error> {
    redirect_messages();
    let graphics = Context::open(device)?;
    let software = gl_strings()?;
    Ok(RendererDescription { device: graphics.device(), software })
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
