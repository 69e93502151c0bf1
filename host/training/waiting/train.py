import sys,time,math,argparse,torch,numpy as np
from data import *; from model import *
ap=argparse.ArgumentParser(); ap.add_argument('--eq',type=int,default=1); ap.add_argument('--down',default='2')
ap.add_argument('--widths',default='24,48,64'); ap.add_argument('--steps',type=int,default=2000); ap.add_argument('--rate',type=float,default=3e-3)
ap.add_argument('--out',default=''); ap.add_argument('--seed',type=int,default=1); ap.add_argument('--batch',type=int,default=32); ap.add_argument('--fine',default=''); ap.add_argument('--threads',type=int,default=2)
ap.add_argument('--total',type=float,default=.2); ap.add_argument('--ema',type=float,default=0)
a=ap.parse_args(); torch.manual_seed(a.seed); torch.set_num_threads(a.threads)
g,f=load('train'); vg,vf=load('validation'); tg,tf=load('test'); cg,cf=load('calibration')
def loss(p,t):
    om=lambda x:x.mean((1,2,3))
    w=1/(om(t**2)+0.02)
    e=(p-t)**2
    l=om(e[:,:2])*2*2/3+om(e[:,2:])/3
    sh=lambda m:(m[:,:2].pow(2).sum(1)+1e-3).sqrt()
    cone=lambda m:sh(m)-0.45*m[:,2]
    ld=(t[:,2]>0.2).float()
    l=l+((cone(p)-cone(t))**2*ld).mean((1,2))*0.5
    l=l*w
    S=lambda x:x.sum((2,3))
    l=l+a.total*((S(p)-S(t))**2).sum(1)/((S(t)**2).sum(1)+30)
    return l.mean()
def fwd(net,g):
    x,r=inputs(g); return net(x)*(r*SCALE)[:,None,None,None]
def predict(net,g):
    net.eval()
    with torch.no_grad(): return torch.cat([fwd(net,g[i:i+200]) for i in range(0,len(g),200)])*0.05
def ratio(m,c,mu):
    con=m[:,2]>c; st=con&((m[:,0]**2+m[:,1]**2)<=mu*mu*m[:,2]**2)
    n=con.sum((1,2)); return torch.where(n>0,st.sum((1,2))/n.clamp_min(1),torch.zeros(())),n
def ratios(p,t,c,mu):
    tr,n=ratio(t,c,0.45); pr,_=ratio(p,c,mu); k=n>=SCT
    return pr[k],tr[k]
SCT=12
def calibrate(p,t):
    k=t.sum((2,3))[:,2]>=0.5; p,t=p[k],t[k]; best=(9,)
    for c in CMINS:
        b=min((abs((lambda q:(q[0]-q[1]).mean().item())(ratios(p,t,c,s*0.0025))),s) for s in range(140,201))
        pr,tr=ratios(p,t,c,b[1]*0.0025); e=(pr-tr).abs().mean().item()
        if e<best[0]: best=(e,c,b[1]*0.0025)
    return best[1:]
CMINS=[0.01,0.015,0.02,0.03]
def scores(net):
    c,mu=calibrate(predict(net,cg),cf); p,t=predict(net,tg),tf
    P,T=p.sum((2,3)),t.sum((2,3)); k=T[:,2]>0.5
    FN=((P-T)[:,2].abs()/T[:,2])[k].median().item()
    L=T[:,:2].norm(dim=1); k2=k&(L>SS)
    FT=((P-T)[:,:2].norm(dim=1)/L)[k2].median().item()
    pr,tr=ratios(p[k],t[k],c,mu)
    con=(t.abs().sum((1,2,3))>0); rel=(((p-t)**2).sum((1,2,3))/(t**2).sum((1,2,3)).clamp_min(1e-12))[con].mean().item()
    return f'c {c} mu {mu:.4f} F_N {100*FN:.2f} F_T {100*FT:.2f} SR {(pr-tr).abs().mean():.4f} agree {100*((pr<.5)==(tr<.5)).float().mean():.2f} err2 {rel:.4f}'
SS=0.1
SCT=8; SS=0.2; CMINS=[0.01,0.015,0.02,0.025,0.03]
if __name__=='__main__':
    net=Net(tuple(map(int,a.widths.split(','))),bool(a.eq),a.down)
    if a.fine: net.load_state_dict(torch.load(a.fine)); print(scores(net),flush=True)
    opt=torch.optim.AdamW(net.parameters(),lr=a.rate,weight_decay=1e-3,eps=1e-8)
    W=0.15
    ease=lambda x,y,t:y+(x-y)*(1+math.cos(math.pi*t))/2
    sched=lambda p: ease(1/25,1,p/W) if p<W else ease(1,.01,(p-W)/(1-W))
    n=len(g); order=torch.randperm(n); at=0; t0=time.time(); run=None
    print(n,len(tg),sum(p.numel() for p in net.parameters()),flush=True)
    for step in range(a.steps):
        if at+a.batch>n: order=torch.randperm(n); at=0
        s=order[at:at+a.batch]; at+=a.batch
        G,T=g[s],f[s]/0.05
        if not a.eq:
            k=torch.randint(0,8,(len(s),))
            G=G.clone();T=T.clone()
            for j in range(8):
                m=k==j
                if m.any(): G[m]=sym_grid(G[m],j); T[m]=sym_grid(T[m],j)
        for q in opt.param_groups: q['lr']=a.rate*sched(step/a.steps)
        net.train(); l=loss(fwd(net,G),T); opt.zero_grad(); l.backward(); opt.step()
        run=l.item() if run is None else .98*run+.02*l.item()
        if (step+1)%max(1,a.steps//8)==0:
            net.eval(); 
            with torch.no_grad(): v=np.mean([loss(fwd(net,vg[i:i+200]),vf[i:i+200]/0.05).item() for i in range(0,len(vg),200)])
            print(f'{time.time()-t0:6.0f}s {(step+1)*a.batch} train {run:.4f} val {v:.4f} {scores(net)}',flush=True)
            if a.out: torch.save(net.state_dict(),a.out)
