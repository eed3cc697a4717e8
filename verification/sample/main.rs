//! The studies on a sample of their scenes, small enough for every test run.

#[path = "definiteness.rs"]
mod definiteness_sample;
#[path = "exactness.rs"]
mod exactness_sample;
#[path = "statics.rs"]
mod statics_sample;
mod stochastic;
mod stochastic_step;
#[path = "study.rs"]
mod study_sample;
#[path = "zoo.rs"]
mod zoo_sample;

#[allow(dead_code, reason = "the sample uses a part of it")]
#[path = "../definiteness/mod.rs"]
mod definiteness;
#[allow(dead_code, reason = "the sample uses a part of it")]
#[path = "../exactness/pair.rs"]
mod pair;
#[allow(dead_code, reason = "the sample uses a part of it")]
#[path = "../statics/mod.rs"]
mod statics;
#[allow(dead_code, reason = "the sample uses a part of it")]
#[path = "../study/mod.rs"]
mod study;
#[path = "../zoo/mod.rs"]
mod zoo;
