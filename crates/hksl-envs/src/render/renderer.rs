//! Rendering of a simulation with MuJoCo's renderer.

use std::mem::ManuallyDrop;

use mujoco_rs::prelude::{
    MjModel, MjrContext, MjrRectangle, MjtFontScale, MjtRndFlag, MjtVisFlag, MjvCamera, MjvOption,
    MjvPerturb, MjvScene,
};
use ndarray::{Array3, ArrayView3, s};

use super::context::Context;
use super::{RenderDevice, RenderSettings};
use crate::Error;
use crate::dmc::Physics;

/// The camera of all tasks' frames.
pub(crate) const CAMERA: usize = 0;
/// Capacity for rendered geoms beyond the model's, such as tendons. dm_control allocates 1000 in total.
const EXTRA_GEOMS: usize = 1000;

/// Renders a simulation, on the thread that created the renderer.
///
/// All options other than the settings have the defaults of MuJoCo and the model, as in dm_control.
pub(crate) struct Renderer {
    scene: MjvScene,
    context: ManuallyDrop<MjrContext>,
    /// Must outlive `context`, which requires it to be current.
    graphics: Context,
    option: MjvOption,
    camera: MjvCamera,
    viewport: MjrRectangle,
    /// Pixels, bottom row first.
    pixels: Vec<u8>,
    height: usize,
    width: usize,
}

impl Renderer {
    /// Creates a renderer of `height` × `width` frames for the model of `physics`.
    pub(crate) fn new(
        physics: &mut Physics,
        (height, width): (usize, usize),
        settings: RenderSettings,
        device: RenderDevice,
    ) -> Result<Self, Error> {
        let task = physics.task();
        let data = physics.data_mut();
        let (rows, columns) = (whole(height)?, whole(width)?);
        // MuJoCo renders to a buffer of this size and crops larger frames.
        let buffer = &mut data.model_vis_mut().global;
        buffer.offheight = buffer.offheight.max(rows);
        buffer.offwidth = buffer.offwidth.max(columns);
        let quality = &mut data.model_vis_mut().quality;
        quality.offsamples = whole(settings.samples)?;
        quality.shadowsize = whole(settings.shadow_map)?;
        let graphics = Context::open(device)?;
        check_size(task, (height, width), graphics.largest_side())?;
        let model = data.model();
        let context = ManuallyDrop::new(new_context(&graphics, model)?);
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

    /// Renders the current state from camera 0 as `(3, height, width)`.
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
    #[allow(unsafe_code)]
    fn drop(&mut self) {
        match self.graphics.make_current() {
            // SAFETY: nothing uses the context after this, and nothing else drops it. What MuJoCo keeps on the
            // device is freed through the current context, which is its own.
            Ok(()) => unsafe { ManuallyDrop::drop(&mut self.context) },
            // Leaks memory until the process ends.
            Err(error) => tracing::debug!("a renderer could not be freed: {error}"),
        }
    }
}

/// Checks the frame size against the driver's limit. Beyond it, MuJoCo would terminate the process.
fn check_size(
    task: &str,
    (height, width): (usize, usize),
    largest: Option<usize>,
) -> Result<(), Error> {
    let Some(largest) = largest else { return Ok(()) };
    for (name, side) in [("height", height), ("width", width)] {
        if side > largest {
            let expected = format!("at most {largest}, the most that the driver draws");
            let (task, value) = (task.to_owned(), side.to_string());
            return Err(Error::Setting { task, name, value, expected });
        }
    }
    Ok(())
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

/// Converts a number of pixels to MuJoCo's type.
fn whole(count: usize) -> Result<i32, Error> {
    i32::try_from(count).map_err(|_| Error::Graphics {
        reason: format!("a picture {count} pixels high or wide is out of range"),
    })
}
