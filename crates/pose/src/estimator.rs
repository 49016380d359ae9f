//! A network that looks at the pictures of one camera, one after the other.

use crate::{
    CropMap, ImageView, Person, Result,
    card::{Layout, MapSpec, Model, ModelCard, OpenPoseSpec, OutputKind, Region},
    decode::{MapView, OpenPoseDecoder, blazepose, movenet, movenet_multi},
    network::{Network, Output},
    preprocess::Preprocessor,
    runtime::{Runtime, RuntimeInfo},
};

#[cfg(doc)]
use crate::Error;

mod mirror;
mod region;
mod track;

pub use region::RegionOptions;

use mirror::Mirror;
use region::Tracker;
use track::Sizes;

/// A part of the work on one look at a picture, in the order in which they are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// From picture to input tensor.
    Preprocess,
    /// The network.
    Network,
    /// From its numbers to people.
    Decode,
}

impl Stage {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Preprocess, Self::Network, Self::Decode];

    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Preprocess => "preprocess",
            Self::Network => "network",
            Self::Decode => "decode",
        }
    }
}

/// Finds people in the pictures of one camera.
///
/// A network for one person looks at a square around the person of the picture before. In the first picture, and after the
/// person was lost, it looks at the whole picture, at parts of it when that shows nobody, and again around what it found.
/// Make one estimator for each camera; they share the runtime.
#[derive(Debug)]
pub struct Estimator {
    card: ModelCard,
    network: Network,
    preprocessor: Preprocessor,
    decoder: Option<OpenPoseDecoder>,
    mirror: Option<Mirror>,
    tracker: Option<Tracker>,
    last: Option<CropMap>,
}

impl Estimator {
    /// Loads a model and runs it once on an empty picture, so that a wrong shape is found here and not later.
    ///
    /// # Errors
    /// What [`Model::read_weights`] returns, [`Error::BadNetwork`](crate::Error::BadNetwork), [`Error::WrongShape`](crate::Error::WrongShape), [`Error::Provider`](crate::Error::Provider),
    /// [`Error::Inference`](crate::Error::Inference), [`Error::NonFinite`](crate::Error::NonFinite).
    pub fn load(model: &Model, runtime: &Runtime) -> Result<Self> {
        Self::with_region(model, runtime, model.card.region(), RegionOptions::default())
    }

    /// As [`Estimator::load`], with another choice of where to look than the card's.
    ///
    /// # Errors
    /// As [`Estimator::load`], and [`Error::Parameter`](crate::Error::Parameter).
    pub fn with_region(model: &Model, runtime: &Runtime, region: Region, options: RegionOptions) -> Result<Self> {
        options.validate()?;
        let network = Network::load(model, runtime)?;
        let card = model.card.clone();
        let decoder = card.openpose.as_ref().map(|spec| OpenPoseDecoder::new(card.skeleton, spec, card.min_score));
        let mut new = Self {
            preprocessor: Preprocessor::new(&card.input),
            decoder,
            mirror: None,
            tracker: match region {
                Region::Full => None,
                Region::Track => Some(Tracker::new(options)),
            },
            card,
            network,
            last: None,
        };
        let (w, h) = (new.preprocessor.width(), new.preprocessor.height());
        let grey = vec![128; w * h * 3];
        new.look(ImageView::new(w, h, &grey)?, CropMap::letterbox(w, h, w, h), &mut |_| {})?;
        new.last = None;
        Ok(new)
    }

    /// Looks at every picture a second time, mirrored, and decodes the mean of both answers: more exact, and twice the work.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) for a network that does not answer with confidence maps and fields of both sides.
    pub fn mirrored(mut self) -> Result<Self> {
        self.mirror = Some(Mirror::new(&self.card)?);
        Ok(self)
    }

    /// The people in a picture, best first, in picture coordinates. Empty when nobody is there.
    ///
    /// # Errors
    /// [`Error::Inference`](crate::Error::Inference), [`Error::NonFinite`](crate::Error::NonFinite), [`Error::WrongShape`](crate::Error::WrongShape).
    pub fn estimate(&mut self, image: ImageView<'_>) -> Result<Vec<Person>> {
        self.estimate_observed(image, &mut |_| {})
    }

    /// As [`Estimator::estimate`], and says at the end of each stage which one it was, so that the caller's clock can time
    /// them. A search looks several times at one picture.
    ///
    /// # Errors
    /// As [`Estimator::estimate`].
    pub fn estimate_observed(&mut self, image: ImageView<'_>, observe: &mut dyn FnMut(Stage)) -> Result<Vec<Person>> {
        self.fit_shape(image);
        let Some(mut tracker) = self.tracker.take() else {
            return self.look(image, self.letterbox(image), observe);
        };
        let sizes = Sizes {
            picture: (image.width(), image.height()),
            tensor: (self.preprocessor.width(), self.preprocessor.height()),
        };
        let found = tracker.track(sizes, &mut |crop| self.look(image, crop, observe));
        self.tracker = Some(tracker);
        found
    }

    /// Forgets the person of the picture before, for a cut or a new recording.
    pub fn reset(&mut self) {
        if let Some(tracker) = &mut self.tracker {
            tracker.forget();
        }
    }

    /// What the network is.
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// What runs it.
    pub fn runtime_info(&self) -> &RuntimeInfo {
        self.network.info()
    }

    /// The part of the last picture that the network saw last.
    pub fn last_crop(&self) -> Option<CropMap> {
        self.last
    }

    fn letterbox(&self, image: ImageView<'_>) -> CropMap {
        CropMap::letterbox(image.width(), image.height(), self.preprocessor.width(), self.preprocessor.height())
    }

    /// A network that takes any size gets the picture's shape at the card's area.
    fn fit_shape(&mut self, image: ImageView<'_>) {
        let Some(spec) = self.card.openpose.as_ref().filter(|_| self.card.input.dynamic) else { return };
        if self.tracker.is_some() {
            return;
        }
        let area = (self.card.input.width * self.card.input.height) as f32;
        let aspect = image.width() as f32 / image.height() as f32;
        let cells = |side: f32| ((side / spec.stride as f32).round() as usize).max(4) * spec.stride;
        let (w, h) = (cells((area * aspect).sqrt()), cells((area / aspect).sqrt()));
        if (w, h) != (self.preprocessor.width(), self.preprocessor.height()) {
            self.preprocessor.resize(w, h);
        }
    }

    /// One run of the network on one crop, or one on each side of the mirror.
    fn look(&mut self, image: ImageView<'_>, crop: CropMap, observe: &mut dyn FnMut(Stage)) -> Result<Vec<Person>> {
        let Self { card, network, preprocessor, decoder, mirror, last, .. } = self;
        preprocessor.fill(image, crop);
        observe(Stage::Preprocess);
        *last = Some(crop);
        let path = network.path();
        let size = (preprocessor.width(), preprocessor.height());
        let names = card.output_names();
        let wrong = |i: usize, expected: String, outputs: &[Output<'_>]| {
            Network::wrong_shape(path.clone(), &format!("output {}", names[i]), expected, outputs[i].shape)
        };
        if let Some((mirror, spec)) = mirror.as_mut().zip(card.openpose.as_ref()) {
            preprocessor.mirror();
            network.run(preprocessor, &names, |outputs| {
                let (pcm, paf) = maps(outputs, spec, size).map_err(|(i, expected)| wrong(i, expected, outputs))?;
                mirror.keep(pcm, paf);
                Ok(())
            })?;
            preprocessor.mirror();
        }
        let mut people = network.run(preprocessor, &names, |outputs| {
            observe(Stage::Network);
            let exactly = |i: usize, shape: &[i64]| {
                if outputs[i].shape == shape { Ok(()) } else { Err(wrong(i, format!("{shape:?}"), outputs)) }
            };
            match card.output {
                OutputKind::OpenPose => {
                    let (Some(spec), Some(decoder)) = (&card.openpose, decoder) else {
                        unreachable!("the card was checked")
                    };
                    let (pcm, paf) = maps(outputs, spec, size).map_err(|(i, expected)| wrong(i, expected, outputs))?;
                    let (pcm, paf) = match mirror {
                        Some(mirror) => mirror.mean(pcm, paf),
                        None => (pcm, paf),
                    };
                    Ok(decoder.decode(pcm, paf))
                }
                OutputKind::MoveNet => {
                    exactly(0, &[1, 1, 17, 3])?;
                    Ok(movenet(outputs[0].data, size.0, size.1, card.min_score).into_iter().collect())
                }
                OutputKind::MoveNetMulti => {
                    if outputs[0].shape.len() != 3 || outputs[0].shape[2] != 56 {
                        return Err(wrong(0, "[1, people, 56]".to_owned(), outputs));
                    }
                    Ok(movenet_multi(outputs[0].data, size.0, size.1, card.min_score))
                }
                OutputKind::BlazePose => {
                    exactly(0, &[1, 195])?;
                    exactly(1, &[1, 1])?;
                    Ok(blazepose(outputs[0].data, outputs[1].data[0], card.min_score).into_iter().collect())
                }
            }
        })?;
        for keypoint in people.iter_mut().flat_map(|p| p.keypoints.iter_mut().flatten()) {
            (keypoint.u_px, keypoint.v_px) = crop.to_picture(keypoint.u_px, keypoint.v_px);
        }
        observe(Stage::Decode);
        Ok(people)
    }
}

/// Confidence maps and fields, or the output whose shape is wrong and what was expected.
fn maps<'a>(
    outputs: &[Output<'a>],
    spec: &OpenPoseSpec,
    tensor: (usize, usize),
) -> Result<(MapView<'a>, MapView<'a>), (usize, String)> {
    let view = |i: usize, map| view(&outputs[i], spec, map, tensor).map_err(|expected| (i, expected));
    Ok((view(0, &spec.pcm)?, view(1, &spec.paf)?))
}

/// The maps of an output, if its shape is the tensor's over the stride; else what was expected.
fn view<'a>(
    output: &Output<'a>,
    spec: &OpenPoseSpec,
    map: &MapSpec,
    tensor: (usize, usize),
) -> Result<MapView<'a>, String> {
    let (width, height) = (tensor.0 / spec.stride, tensor.1 / spec.stride);
    let channels = match (output.shape, spec.layout) {
        ([1, c, h, w], Layout::Nchw) | ([1, h, w, c], Layout::Nhwc)
            if (*h, *w) == (height as i64, width as i64) && *c >= (map.first + map.channels) as i64 =>
        {
            *c as usize
        }
        _ => {
            let channels = format!("at least {} channels", map.first + map.channels);
            return Err(match spec.layout {
                Layout::Nchw => format!("[1, {channels}, {height}, {width}]"),
                Layout::Nhwc => format!("[1, {height}, {width}, {channels}]"),
            });
        }
    };
    Ok(MapView { data: output.data, layout: spec.layout, channels, first: map.first, width, height })
}
